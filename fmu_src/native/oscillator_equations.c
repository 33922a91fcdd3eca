#include "oscillator_equations.h"

#include <stddef.h>

struct transformation transformation_of(double theta, bool reflection)
{
    const double c = cos(theta), s = sin(theta);
    const struct transformation rotation = {c, -s, s, c}, mirror = {-c, s, s, c};
    return reflection ? mirror : rotation;
}

struct damping damping_of(const struct parameters *p)
{
    const double c = cos(p->theta), s = sin(p->theta), w12 = c * s * (p->d1 - p->d2);
    const struct damping d = {c * c * p->d1 + s * s * p->d2, s * s * p->d1 + c * c * p->d2,
                              p->reflection ? -w12 : w12};
    return d;
}

struct coupling coupling_of(const struct parameters *p)
{
    const double c = cos(p->theta), s = sin(p->theta);
    /* the root of each factor, so that no square leaves the range of a double */
    const double factor = -0.5 * sin(2.0 * p->theta) * (p->eta_minus - p->eta_plus);
    const struct coupling found = {
        factor >= 0.0 ? sqrt(factor) * sqrt(p->eta_minus + p->eta_plus) : NAN,
        hypot(c * p->eta_plus, s * p->eta_minus),
        hypot(s * p->eta_plus, c * p->eta_minus),
    };
    return found;
}

/* eta^2 - u^2 of both modes as products. */
static void detunings(const struct parameters *p, double u, double *x, double *y)
{
    *x = (p->eta_plus - u) * (p->eta_plus + u);
    *y = (p->eta_minus - u) * (p->eta_minus + u);
}

/* det(diag(x, y) + i carrier D~/2 pi), the squares of D~ contracted to d1 d2, so that nothing
 * cancels at high Q or where one damping coefficient is far above the other. */
static struct complex determinant_of(const struct parameters *p, double x, double y, double carrier)
{
    const struct damping w = damping_of(p);
    return complex_of(x * y - carrier * carrier * p->d1 * p->d2,
                      carrier * (x * w.w22 + y * w.w11));
}

/* adj(D~ / 2 pi) g = d_low g + (d_high - d_low) n (n . g), n the column of T across: the small
 * damping coefficient keeps its digits beside a large one. */
static void damping_adjugate(const struct parameters *p, double v[2])
{
    const struct transformation t = transformation_of(p->theta, p->reflection);
    const bool first = p->d1 >= p->d2;
    const double low = first ? p->d2 : p->d1, high = first ? p->d1 : p->d2;
    const double n1 = first ? t.t12 : t.t11, n2 = first ? t.t22 : t.t21;
    const double across = (high - low) * (n1 * p->g1 + n2 * p->g2);
    v[0] = low * p->g1 + across * n1;
    v[1] = low * p->g2 + across * n2;
}

/* A frequency with the detunings and the carrier that the model sees it by. */
struct detuned {
    double u, x, y, carrier;
};

/* ([diag(x, y) + i carrier D~/2 pi]^-1 (g1, g2)^T) / (2 pi)^2 */
static bool solve(const struct parameters *p, struct detuned at, struct pair *found,
                  struct report *report)
{
    const struct complex determinant = determinant_of(p, at.x, at.y, at.carrier);
    const struct complex scale = c_scale(FOUR_PI_SQUARED, determinant);
    double v[2];
    if (c_is_zero(determinant))
        return refuse(report,
                      "a drive at %r Hz has no steady state: it lies on an undamped eigenfrequency",
                      at.u);
    damping_adjugate(p, v);
    found->z[0] = c_divide(complex_of(at.y * p->g1, at.carrier * v[0]), scale);
    found->z[1] = c_divide(complex_of(at.x * p->g2, at.carrier * v[1]), scale);
    return true;
}

bool phasors(const struct parameters *p, double u, struct pair *x, struct report *report)
{
    struct detuned at = {.u = u, .carrier = u};
    detunings(p, u, &at.x, &at.y);
    return solve(p, at, x, report);
}

/* eta^2 - u^2 becomes eta^2 - centre^2 - 2 centre (u - centre), and u D~ becomes centre D~. */
bool rotating_phasors(const struct parameters *p, double u, double centre, struct pair *x,
                      struct report *report)
{
    const double shift = 2.0 * centre * (u - centre);
    const struct detuned at = {
        u,
        (p->eta_plus - centre) * (p->eta_plus + centre) - shift,
        (p->eta_minus - centre) * (p->eta_minus + centre) - shift,
        centre,
    };
    return solve(p, at, x, report);
}

double centre_of(const struct parameters *p)
{
    if (p->A1 != 0.0 && p->A2 != 0.0)
        return (p->u1 + p->u2) / 2.0;
    if (p->A1 != 0.0)
        return p->u1;
    return p->A2 != 0.0 ? p->u2 : 0.5 * (p->eta_plus + p->eta_minus);
}

void physical_displacements(const struct parameters *p, const double q[2], double physical[2])
{
    const struct transformation t = transformation_of(p->theta, p->reflection);
    physical[0] = t.t11 * q[0] + t.t21 * q[1];
    physical[1] = t.t12 * q[0] + t.t22 * q[1];
}

/* A parameter by its name, for what is asked of several. */
struct named {
    const char *name;
    double value;
};

static bool all_finite(const struct parameters *p, struct report *report)
{
    const struct named all[] = {
        {"theta", p->theta}, {"d1", p->d1}, {"d2", p->d2}, {"eta_plus", p->eta_plus},
        {"eta_minus", p->eta_minus}, {"u1", p->u1}, {"u2", p->u2}, {"A1", p->A1}, {"A2", p->A2},
        {"phase1", p->phase1}, {"phase2", p->phase2}, {"g1", p->g1}, {"g2", p->g2},
    };
    for (size_t i = 0; i < sizeof all / sizeof *all; ++i)
        if (!isfinite(all[i].value))
            return refuse(report, "%s = %r is not a finite number", all[i].name, all[i].value);
    return true;
}

/* Warn of growth; refuse where there is no orbit or no steady state. */
static bool check_undamped(const struct parameters *p, bool periodic_start, struct report *report)
{
    const struct named widths[] = {{"d1", p->d1}, {"d2", p->d2}};
    const struct named drives[] = {{"u1", p->u1}, {"u2", p->u2}};
    const double sizes[] = {p->A1, p->A2};
    for (int i = 0; i < 2; ++i) {
        const double value = widths[i].value;
        if (periodic_start && value <= 0.0)
            return refuse(report,
                          "%s = %r Hz: the damping matrix is not positive definite, so there is "
                          "no attracting periodic orbit to start on; set periodic_start to false",
                          widths[i].name, value);
        if (value < 0.0)
            warn(report, "%s = %r Hz is negative: the oscillation may grow", widths[i].name,
                 value);
    }
    for (int i = 0; i < 2; ++i) {
        const double u = drives[i].value;
        double x, y;
        detunings(p, u, &x, &y);
        if (sizes[i] != 0.0 && c_is_zero(determinant_of(p, x, y, u)))
            return refuse(report,
                          "%s = %r Hz lies exactly on an undamped eigenfrequency (eta_plus = %r "
                          "Hz, eta_minus = %r Hz, d1 = %r Hz, d2 = %r Hz): the drive has no "
                          "steady state",
                          drives[i].name, u, p->eta_plus, p->eta_minus, p->d1, p->d2);
    }
    return true;
}

bool check_parameters(const struct parameters *p, bool periodic_start, struct report *report)
{
    const struct named modes[] = {{"eta_plus", p->eta_plus}, {"eta_minus", p->eta_minus}};
    const struct named drives[] = {{"u1", p->u1}, {"u2", p->u2}};
    if (!all_finite(p, report))
        return false;
    for (int i = 0; i < 2; ++i)
        if (modes[i].value <= 0.0)
            return refuse(report, "%s = %r Hz: an eigenfrequency must be above 0 Hz",
                          modes[i].name, modes[i].value);
    for (int i = 0; i < 2; ++i)
        if (drives[i].value < 0.0)
            return refuse(report, "%s = %r Hz: a drive frequency must not be negative",
                          drives[i].name, drives[i].value);
    return (p->d1 > 0.0 && p->d2 > 0.0) || check_undamped(p, periodic_start, report);
}
