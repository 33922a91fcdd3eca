#include "oscillator_exact.h"

/* Poles closer to the real axis than this part of their size are real: oscillating ones made of
 * doubles keep half the digits of a double between them and the axis. */
#define REAL_POLE 1e-12

/* The roots of x^2 - e1 x + e2 as mean plus and minus half their gap. */
static void split_roots(struct precise e1, struct precise e2, struct precise poles[2])
{
    const struct precise mean = precise_multiply(e1, precise_of(0.5, 0.0));
    const struct precise half =
        precise_sqrt(precise_subtract(precise_multiply(mean, mean), e2));
    poles[0] = precise_add(mean, half);
    poles[1] = precise_subtract(mean, half);
}

static bool oscillates(struct precise pole)
{
    const struct real least = real_multiply(real_abs(pole.re), real_of(REAL_POLE));
    return !real_at_most(pole.im, least);
}

/* The pencil x^2 + x D~/2 pi + diag(eta^2) of the full equations. */
bool oscillator_pencil(const struct parameters *p, struct pencil *pencil, struct report *report)
{
    const struct damping w = damping_of(p);
    const struct precise zero = precise_of(0.0, 0.0), one = precise_of(1.0, 0.0);
    const struct precise plus = precise_of(p->eta_plus, 0.0), minus = precise_of(p->eta_minus, 0.0);
    const struct polynomial mode1 =
        polynomial_parabola(precise_multiply(plus, plus), precise_of(w.w11, 0.0), one);
    const struct polynomial mode2 =
        polynomial_parabola(precise_multiply(minus, minus), precise_of(w.w22, 0.0), one);
    const struct polynomial off = polynomial_line(zero, precise_of(w.w12, 0.0));
    const struct polynomial quartic =
        polynomial_add(polynomial_multiply(mode1, mode2),
                       polynomial_negate(polynomial_multiply(off, off)));
    const struct precise guess1 = precise_of(-p->d1 / 2.0, p->eta_plus);
    const struct precise guess2 = precise_of(-p->d2 / 2.0, p->eta_minus);
    struct precise e1 = precise_add(guess1, guess2), e2 = precise_multiply(guess1, guess2);
    bool found = upper_factor(&quartic, &e1, &e2);
    if (found)
        split_roots(e1, e2, pencil->poles);
    /* a real pole of an overdamped mode shows up with a rounding error above or below the axis */
    if (!found || !oscillates(pencil->poles[0]) || !oscillates(pencil->poles[1]))
        return refuse(report,
                      "a mode is overdamped (d1 = %r Hz, d2 = %r Hz at eta_plus = %r Hz, eta_minus "
                      "= %r Hz): the exact solver needs oscillating modes; use solver 2 (rk4) or "
                      "periodic_start",
                      p->d1, p->d2, p->eta_plus, p->eta_minus);
    pencil->adjugate[0][0] = mode2;
    pencil->adjugate[1][1] = mode1;
    pencil->adjugate[0][1] = pencil->adjugate[1][0] = polynomial_negate(off);
    pencil->upper = polynomial_parabola(e2, precise_negate(e1), one);
    pencil->lower = polynomial_conjugate(pencil->upper);
    pencil->mirrored = true;
    return true;
}

/* One diagonal element of the rotating frame's P(0). */
static struct precise rotating_diagonal(double eta, double width, double centre)
{
    const struct precise middle = precise_of(centre, 0.0), exact = precise_of(eta, 0.0);
    const struct precise carrier = precise_of(0.0, centre);
    const struct precise square =
        precise_multiply(precise_subtract(exact, middle), precise_add(exact, middle));
    const struct precise detuning = precise_divide(square, precise_add(carrier, carrier));
    const struct precise half = precise_multiply(precise_of(width, 0.0), precise_of(0.5, 0.0));
    return precise_subtract(precise_add(half, detuning), carrier);
}

/* q~ = Re z, z = a(t) exp(2 pi i centre t) with a'' and D~ a' dropped: P(x) =
 * 2 i centre (x - i centre) + eta^2 - centre^2 + i centre D~/2 pi, divided by 2 i centre. */
bool rotating_pencil(const struct parameters *p, double centre, struct pencil *pencil,
                     struct report *report)
{
    const struct damping w = damping_of(p);
    const struct precise one = precise_of(1.0, 0.0), zero = precise_of(0.0, 0.0);
    const struct precise k12 = precise_multiply(precise_of(w.w12, 0.0), precise_of(0.5, 0.0));
    struct precise scale, k11, k22;
    struct polynomial off;
    if (centre == 0.0)
        return refuse(report,
                      "the rotating frame of solver 1 (envelope) needs a drive above 0 Hz; use "
                      "solver 0 (exact) or 2 (rk4)");
    scale = precise_divide(one, precise_of(0.0, 2.0 * centre));
    k11 = rotating_diagonal(p->eta_plus, w.w11, centre);
    k22 = rotating_diagonal(p->eta_minus, w.w22, centre);
    off = polynomial_line(precise_negate(precise_multiply(k12, scale)), zero);
    pencil->upper = polynomial_add(
        polynomial_multiply(polynomial_line(k11, one), polynomial_line(k22, one)),
        polynomial_constant(precise_negate(precise_multiply(k12, k12))));
    split_roots(precise_negate(pencil->upper.c[1]), pencil->upper.c[0], pencil->poles);
    pencil->adjugate[0][0] = polynomial_line(precise_multiply(k22, scale), scale);
    pencil->adjugate[1][1] = polynomial_line(precise_multiply(k11, scale), scale);
    pencil->adjugate[0][1] = pencil->adjugate[1][0] = off;
    pencil->lower = polynomial_constant(one);
    pencil->mirrored = false;
    return true;
}

struct roots roots_of(const struct pencil *pencil)
{
    const struct precise *x = pencil->poles;
    struct roots roots = {.x1 = precise_complex(x[0]), .x2 = precise_complex(x[1])};
    double high, low;
    roots.gap = precise_complex(precise_subtract(x[0], x[1]));
    roots.growth1 = TWO_PI * roots.x1.re;
    roots.growth2 = TWO_PI * roots.x2.re;
    precise_split(x[0], &high, &low);
    roots.frequency1 = frequency_of(high, low);
    precise_split(x[1], &high, &low);
    roots.frequency2 = frequency_of(high, low);
    return roots;
}

static struct complex over_square(struct precise z)
{
    const struct complex rounded = precise_complex(z);
    return complex_of(rounded.re / FOUR_PI_SQUARED, rounded.im / FOUR_PI_SQUARED);
}

/* F over {conj(x1), conj(x2)}, with U (x - i u) in the place of V. */
static void mirror_of(const struct pencil *pencil, const struct polynomial numerators[2],
                      struct precise node, struct tone_kernel *kernel)
{
    const struct precise images[] = {precise_conjugate(pencil->poles[0]),
                                     precise_conjugate(pencil->poles[1])};
    const struct polynomial factor =
        polynomial_line(precise_negate(node), precise_of(1.0, 0.0));
    const struct differences below =
        polynomial_differences(polynomial_multiply(pencil->upper, factor), images, 2);
    for (int mode = 0; mode < 2; ++mode) {
        struct precise f[MOST_NODES];
        rational_differences(numerators[mode], &below, f);
        kernel->mirror[0].z[mode] = over_square(f[0]);
        kernel->mirror[1].z[mode] = over_square(f[1]);
    }
}

/* The split form, X(u) beside coefficients of E[x1, x2] and E[x2], and the confluent one. */
static void front_of(const struct precise f[MOST_NODES], struct precise gap1, struct precise gap2,
                     int mode, struct tone_kernel *kernel)
{
    const struct precise one = precise_of(1.0, 0.0), both = precise_multiply(gap1, gap2);
    const struct precise h1 = precise_divide(one, gap1);
    const struct precise h12 = precise_negate(precise_divide(one, both));
    for (int i = 0; i < 3; ++i)
        kernel->confluent[i].z[mode] = over_square(f[i]);
    kernel->periodic.z[mode] = over_square(precise_divide(f[0], both));
    kernel->split[0].z[mode] = over_square(precise_add(precise_multiply(f[0], h1), f[1]));
    kernel->split[1].z[mode] = over_square(precise_add(precise_multiply(f[0], h12), f[2]));
}

bool tone_kernel_of(const struct pencil *pencil, const struct parameters *p, double u,
                    struct tone_kernel *kernel, struct report *report)
{
    const struct precise node = precise_of(0.0, u);
    const struct precise nodes[] = {node, pencil->poles[0], pencil->poles[1]};
    const struct precise gap1 = precise_subtract(nodes[1], node);
    const struct precise gap2 = precise_subtract(nodes[2], node);
    const struct polynomial g1 = polynomial_constant(precise_of(p->g1, 0.0));
    const struct polynomial g2 = polynomial_constant(precise_of(p->g2, 0.0));
    const struct differences table = polynomial_differences(pencil->lower, nodes, 3);
    const struct tone_kernel blank = {.node = {0.0, u}};
    struct polynomial numerators[2];
    if (precise_is_zero(gap1) || precise_is_zero(gap2))
        return refuse(report,
                      "the drive frequency %r Hz lies exactly on an undamped eigenfrequency: the "
                      "response has no steady state",
                      u);
    *kernel = blank;
    kernel->gaps[0] = precise_complex(precise_negate(gap1));
    kernel->gaps[1] = precise_complex(precise_negate(gap2));
    for (int mode = 0; mode < 2; ++mode) {
        struct precise f[MOST_NODES];
        numerators[mode] = polynomial_add(polynomial_multiply(pencil->adjugate[mode][0], g1),
                                          polynomial_multiply(pencil->adjugate[mode][1], g2));
        rational_differences(numerators[mode], &table, f);
        front_of(f, gap1, gap2, mode, kernel);
    }
    if (pencil->mirrored)
        mirror_of(pencil, numerators, node, kernel);
    return true;
}

void free_part_of(const struct pencil *pencil, const struct column *columns, int count,
                  struct free_part *part)
{
    const struct differences table = polynomial_differences(pencil->lower, pencil->poles, 2);
    for (int k = 0; k < count; ++k)
        for (int mode = 0; mode < 2; ++mode) {
            const struct polynomial row =
                polynomial_add(polynomial_multiply(pencil->adjugate[mode][0], columns[k].n[0]),
                               polynomial_multiply(pencil->adjugate[mode][1], columns[k].n[1]));
            struct precise f[MOST_NODES];
            rational_differences(row, &table, f);
            part->first[k].z[mode] = precise_complex(f[0]);
            part->second[k].z[mode] = precise_complex(f[1]);
        }
}

/* --- divided differences of exp(2 pi x t) in doubles ------------------------------------------- */

/* exp(z) - 1 without cancellation for small z. */
static struct complex expm1_of(struct complex z)
{
    double real, sine;
    if (c_abs(z) > 0.5)
        return c_subtract(c_rect(exp(z.re), z.im), complex_of(1.0, 0.0));
    real = expm1(z.re);
    sine = sin(0.5 * z.im);
    return complex_of(real - 2.0 * sine * sine * (real + 1.0), sin(z.im) * (real + 1.0));
}

struct complex first_difference(struct complex ea, struct complex eb, struct complex gap, double t)
{
    const struct complex angle = c_scale(TWO_PI * t, gap);
    if (c_abs(angle) > 0.5)
        return c_divide(c_subtract(ea, eb), gap);
    if (c_is_zero(gap))
        return c_scale(TWO_PI * t, eb);
    return c_multiply(eb, c_divide(expm1_of(angle), gap));
}

/* The Taylor series of complete homogeneous polynomials where all poles lie close. */
static struct complex close_difference(struct complex za, struct complex zb)
{
    struct complex total = {0.0, 0.0}, term = {1.0, 0.0}, power = {1.0, 0.0};
    double factorial = 2.0;
    for (int order = 3; order < 25; ++order) {
        total = c_add(total, complex_of(term.re / factorial, term.im / factorial));
        power = c_multiply(power, zb);
        term = c_add(c_multiply(term, za), power);
        factorial *= order;
    }
    return total;
}

/* Elsewhere the recursion over the widest gap, so that no difference of nearly equal numbers is
 * divided by a small one. The gaps are given because the poles would say them with too few digits. */
struct complex second_difference(const struct complex gaps[3], const struct complex values[3],
                                 double t)
{
    const double scale = TWO_PI * t;
    const struct complex za = c_scale(scale, gaps[1]), zb = c_scale(scale, gaps[2]);
    struct complex ab = gaps[0], ac = gaps[1], bc = gaps[2], ea = values[0], eb = values[1];
    if (c_abs(za) < 1.0 && c_abs(zb) < 1.0)
        return c_scale(scale * scale, c_multiply(values[2], close_difference(za, zb)));
    if (c_abs(za) < c_abs(zb)) {
        ab = c_scale(-1.0, ab);
        ac = gaps[2];
        bc = gaps[1];
        ea = values[1];
        eb = values[0];
    }
    return c_divide(c_subtract(first_difference(ea, eb, ab, t),
                               first_difference(eb, values[2], bc, t)),
                    ac);
}
