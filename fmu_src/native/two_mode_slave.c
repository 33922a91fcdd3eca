#include "two_mode_slave.h"

#include <string.h>

struct parameters parameters_of(const struct slave *slave)
{
    const double *v = slave->values;
    const struct parameters p = {
        v[V_theta], v[V_reflection] != 0.0, v[V_d1], v[V_d2], v[V_eta_plus], v[V_eta_minus],
        v[V_u1],    v[V_u2],                v[V_A1], v[V_A2], v[V_phase1],   v[V_phase2],
        v[V_g1],    v[V_g2],
    };
    return p;
}

void write_derived(const struct parameters *p, double *outputs, struct report *report)
{
    const struct coupling c = coupling_of(p);
    const struct damping w = damping_of(p);
    const double derived[DERIVED_COUNT] = {
        c.lambda,
        c.f1,
        c.f2,
        TWO_PI * w.w11,
        TWO_PI * w.w22,
        TWO_PI * w.w12,
        w.w11,
        w.w22,
        w.w11 > 0.0 ? p->eta_plus / w.w11 : NAN,
        w.w22 > 0.0 ? p->eta_minus / w.w22 : NAN,
    };
    if (isnan(c.lambda))
        warn(report,
             "lambda is not a real number at theta = %r rad (sin 2 theta > 0 with eta_plus = %r "
             "Hz, eta_minus = %r Hz): it is NaN",
             p->theta, p->eta_plus, p->eta_minus);
    memcpy(outputs, derived, sizeof derived);
}

bool check_substep(double substep, struct report *report)
{
    if (0.0 <= substep && substep < INFINITY)
        return true;
    return refuse(report, "rk4_substep = %r s: 0 or a positive time is wanted", substep);
}
