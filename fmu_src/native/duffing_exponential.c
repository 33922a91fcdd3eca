#include "duffing_exponential.h"

/* exp(z) and phi_1..3, with phi_k(z) = (phi_{k-1}(z) - 1/(k-1)!)/z, phi_0 = exp. */
struct phi {
    struct complex e, p1, p2, p3;
};

static struct complex less(struct complex z, double x)
{
    return complex_of(z.re - x, z.im);
}

static struct phi phi_of(struct complex z)
{
    struct phi p = {.p3 = {0.0, 0.0}};
    struct complex term = {1.0 / 6.0, 0.0};
    if (c_abs(z) > 1.5) {
        p.e = c_rect(exp(z.re), z.im);
        p.p1 = c_divide(less(p.e, 1.0), z);
        p.p2 = c_divide(less(p.p1, 1.0), z);
        p.p3 = c_divide(less(p.p2, 0.5), z);
        return p;
    }
    for (int k = 4; k < 26; ++k) {
        p.p3 = c_add(p.p3, term);
        term = c_multiply(term, complex_of(z.re / k, z.im / k));
    }
    p.p2 = less(c_multiply(z, p.p3), -0.5);
    p.p1 = less(c_multiply(z, p.p2), -1.0);
    p.e = less(c_multiply(z, p.p1), -1.0);
    return p;
}

static struct spread spread_of(struct complex rate, double h, double theta)
{
    const double span = theta * h;
    const struct phi p = phi_of(c_scale(span, rate));
    const struct complex first = c_scale(span, p.p1), second = c_scale(span * theta, p.p2);
    const struct complex third = c_scale(4.0 * span * theta * theta, p.p3);
    const struct spread s = {
        p.e,
        c_add(c_subtract(first, c_scale(3.0, second)), third),
        c_subtract(c_scale(2.0, second), third),
        c_subtract(third, second),
    };
    return s;
}

static struct complex spread_value(const struct spread *s, struct complex y,
                                   const struct slopes *n)
{
    const struct complex begun =
        c_add(c_multiply(s->turn, y), c_multiply(s->begin, n->begin));
    return c_add(c_add(begun, c_multiply(s->middle, n->middle)), c_multiply(s->end, n->end));
}

/* Where a cubic is furthest from its parabola through 0, 1/2 and 1. */
double probe_place(void)
{
    return 0.5 - 0.5 / sqrt(3.0);
}

double notched(double h)
{
    static const double notches[] = {0.8408964152537145, 0.7071067811865476, 0.5946035575013605,
                                     0.5};
    double mantissa;
    int exponent, i = 0;
    if (!(0.0 < h && h < INFINITY))
        return h;
    mantissa = frexp(h, &exponent);
    while (notches[i] > mantissa)
        ++i;
    return ldexp(notches[i], exponent);
}

struct weights weights_of(struct complex rate, double h)
{
    const double probe = probe_place();
    const struct phi half = phi_of(c_scale(0.5 * h, rate)), full = phi_of(c_scale(h, rate));
    const struct weights w = {
        half.e,
        c_scale(0.5 * h, half.p1),
        c_scale(h, half.p2),
        c_scale(h, full.p1),
        c_scale(2.0 * h, full.p2),
        spread_of(rate, h, 1.0),
        spread_of(rate, h, probe),
        /* the integral of the cubic over the first half of a step */
        h * ((1.0 / 64.0) / (probe * (probe - 0.5) * (probe - 1.0))),
    };
    return w;
}

struct pair step_between(const struct step *step, const struct complex rates[2], double t)
{
    const double theta = (t - step->t) / step->h;
    struct pair y;
    if (t == step->t + step->h)
        return step->y_end;
    for (int i = 0; i < 2; ++i) {
        const struct spread s = spread_of(rates[i], step->h, theta);
        y.z[i] = spread_value(&s, step->y.z[i], &step->slopes[i]);
    }
    return y;
}

/* What the parabola through the slopes misses at the probe, of y. */
static double missed(const struct weights *w, struct complex probed, const struct slopes *n)
{
    const double x = probe_place();
    const double parabola[] = {(2.0 * x - 1.0) * (x - 1.0), 2.0 * x * (1.0 - x), x * (2.0 * x - 1.0)};
    const struct complex there =
        c_add(c_add(c_scale(parabola[0], n->begin), c_scale(parabola[1], n->middle)),
              c_scale(parabola[2], n->end));
    return w->missed * c_abs(c_subtract(probed, there));
}

/* S. Krogstad, J. Comput. Phys. 203, 72 (2005), scheme ETDRK4-B. */
struct step step_from(const struct beginning *from, double h, const struct weights weights[2],
                      slope_function *slope, const void *model)
{
    struct step step = {.t = from->t, .h = h, .y = from->y};
    struct pair half, second, whole, probe, b, c, d, probed, qb, qc, q, unread;
    for (int i = 0; i < 2; ++i)
        half.z[i] = c_add(c_multiply(weights[i].half, from->y.z[i]),
                          c_multiply(weights[i].half_first, from->n.z[i]));
    slope(model, &half, &from->middle, &b, &qb);
    for (int i = 0; i < 2; ++i)
        second.z[i] = c_add(half.z[i], c_multiply(weights[i].half_second,
                                                  c_subtract(b.z[i], from->n.z[i])));
    slope(model, &second, &from->middle, &c, &qc);
    for (int i = 0; i < 2; ++i)
        whole.z[i] = c_add(c_add(c_multiply(weights[i].full.turn, from->y.z[i]),
                                 c_multiply(weights[i].full_first, from->n.z[i])),
                           c_multiply(weights[i].full_second, c_subtract(c.z[i], from->n.z[i])));
    slope(model, &whole, &from->there, &d, &unread);
    for (int i = 0; i < 2; ++i) {
        step.slopes[i].begin = from->n.z[i];
        step.slopes[i].middle = c_add(b.z[i], c.z[i]);
        step.slopes[i].end = d.z[i];
        step.y_end.z[i] = spread_value(&weights[i].full, from->y.z[i], &step.slopes[i]);
        probe.z[i] = spread_value(&weights[i].probe, from->y.z[i], &step.slopes[i]);
    }
    slope(model, &step.y_end, &from->there, &step.n_end, &q);
    slope(model, &probe, &from->probed, &probed, &unread);
    for (int i = 0; i < 2; ++i) {
        step.error[i] = missed(&weights[i], probed.z[i], &step.slopes[i]);
        step.largest[i] = fmax(c_abs(q.z[i]), fmax(c_abs(qb.z[i]), c_abs(qc.z[i])));
    }
    return step;
}
