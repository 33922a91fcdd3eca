#include "oscillator_rk4.h"

#include <string.h>

enum { SUBSTEPS_PER_PERIOD = 40 }; /* of the fastest frequency, where the substep is left open */

void rk4_prepare(struct rk4_solver *solver, const struct parameters *p, double substep,
                 const double offsets[2])
{
    const double u[] = {p->u1, p->u2}, size[] = {p->A1, p->A2}, phase[] = {p->phase1, p->phase2};
    /* a tone that is switched off has no frequency */
    const double driven = fmax(p->A1 != 0.0 ? p->u1 : 0.0, p->A2 != 0.0 ? p->u2 : 0.0);
    const double fastest = fmax(fmax(p->eta_plus, p->eta_minus), driven);
    const struct damping w = damping_of(p);
    const double plus = TWO_PI * p->eta_plus, minus = TWO_PI * p->eta_minus;
    memset(solver, 0, sizeof *solver);
    solver->p = *p;
    solver->requested = substep;
    solver->substep = substep != 0.0 ? substep : 1.0 / (SUBSTEPS_PER_PERIOD * fastest);
    solver->damping.w11 = TWO_PI * w.w11;
    solver->damping.w22 = TWO_PI * w.w22;
    solver->damping.w12 = TWO_PI * w.w12;
    solver->stiffness[0] = plus * plus;
    solver->stiffness[1] = minus * minus;
    for (int i = 0; i < 2; ++i) {
        struct rk4_tone *tone = &solver->tone[solver->tones];
        solver->offsets[i] = offsets[i];
        if (size[i] == 0.0)
            continue;
        tone->amplitude = size[i];
        tone->offset = offsets[i] + phase[i] / TWO_PI;
        tone->frequency = frequency_of(u[i], 0.0);
        ++solver->tones;
    }
}

static double angle_at(const struct rk4_tone *tone, double t)
{
    return TWO_PI * (frequency_cycles(&tone->frequency, t, 0.0) + tone->offset);
}

/* The periodic orbit, with the held input's displacement; velocities over 2 pi. */
static bool orbit_at(const struct rk4_solver *solver, double t, struct state *state,
                     struct report *report)
{
    memset(state, 0, sizeof *state);
    state->z[0].re = solver->b * solver->p.g1 / solver->stiffness[0];
    state->z[1].re = solver->b * solver->p.g2 / solver->stiffness[1];
    for (int i = 0; i < solver->tones; ++i) {
        const struct rk4_tone *tone = &solver->tone[i];
        const struct complex turn = c_rect(tone->amplitude, angle_at(tone, t));
        const struct complex i_u = complex_of(0.0, tone->frequency.high);
        struct pair x;
        if (!phasors(&solver->p, tone->frequency.high, &x, report))
            return false;
        for (int mode = 0; mode < 2; ++mode) {
            state->z[mode].re += c_multiply(x.z[mode], turn).re;
            state->z[2 + mode].re += c_multiply(c_multiply(i_u, x.z[mode]), turn).re;
        }
    }
    return true;
}

bool rk4_start(struct rk4_solver *solver, double t, const struct state *state, double b,
               struct report *report)
{
    struct state orbit;
    solver->b = b;
    solver->t = t;
    if (state == NULL) {
        if (!orbit_at(solver, t, &orbit, report))
            return false;
        state = &orbit;
    }
    for (int i = 0; i < 4; ++i)
        solver->at.y[i] = (i < 2 ? 1.0 : TWO_PI) * state->z[i].re;
    return true;
}

void rk4_take_over(struct rk4_solver *solver, const struct rk4_solver *other)
{
    solver->b = other->b;
    solver->t = other->t;
    solver->at = other->at;
}

static double force_at(const struct rk4_solver *solver, double t)
{
    double force = 0.0;
    for (int i = 0; i < solver->tones; ++i)
        force += solver->tone[i].amplitude * cos(angle_at(&solver->tone[i], t));
    return solver->b + force;
}

/* q~'' of both modes. */
static void acceleration(const struct rk4_solver *solver, double force, const struct point *at,
                         double a[2])
{
    const struct damping d = solver->damping;
    const double *y = at->y, s1 = y[0] * y[0], s2 = y[1] * y[1];
    const double c1 = solver->stiffness[0] + solver->alpha1 * s1 + solver->kappa * s2;
    const double c2 = solver->stiffness[1] + solver->alpha2 * s2 + solver->kappa * s1;
    a[0] = solver->p.g1 * force - d.w11 * y[2] - d.w12 * y[3] - c1 * y[0];
    a[1] = solver->p.g2 * force - d.w12 * y[2] - d.w22 * y[3] - c2 * y[1];
}

/* One substep of the classical fourth-order method, with the drive at its start, middle, end. */
static struct point substep(const struct rk4_solver *solver, const struct point *from, double h,
                            const double force[3])
{
    static const double weights[] = {2.0, 2.0, 1.0}, parts[] = {0.5, 0.5, 1.0};
    static const int forces[] = {1, 1, 2};
    const double *y = from->y;
    struct point k = {{y[2], y[3], 0.0, 0.0}}, total, end;
    acceleration(solver, force[0], from, k.y + 2);
    total = k;
    for (int stage = 0; stage < 3; ++stage) {
        const double s = parts[stage] * h;
        struct point at;
        for (int i = 0; i < 4; ++i)
            at.y[i] = y[i] + s * k.y[i];
        k.y[0] = at.y[2];
        k.y[1] = at.y[3];
        acceleration(solver, force[forces[stage]], &at, k.y + 2);
        for (int i = 0; i < 4; ++i)
            total.y[i] += weights[stage] * k.y[i];
    }
    for (int i = 0; i < 4; ++i)
        end.y[i] = y[i] + h / 6.0 * total.y[i];
    return end;
}

bool rk4_advance(struct rk4_solver *solver, double t, struct report *report)
{
    const double begin = solver->t, span = t - begin;
    const double needed = ceil(span / solver->substep * (1.0 - 1e-12));
    const double count = needed > 1.0 ? needed : 1.0, h = span / count;
    const double stiffest = fmax(solver->stiffness[0], solver->stiffness[1]);
    struct point at = solver->at;
    double force[3] = {force_at(solver, begin), 0.0, 0.0};
    for (double k = 0.0; k < count; k += 1.0) {
        force[1] = force_at(solver, begin + (k + 0.5) * h);
        force[2] = force_at(solver, k + 1.0 < count ? begin + (k + 1.0) * h : t);
        at = substep(solver, &at, h, force);
        force[0] = force[2];
    }
    for (int i = 0; i < 4; ++i)
        if (!isfinite(at.y[i]))
            return refuse(report,
                          "the rk4 solution left the range of numbers at t = %r s with substeps of "
                          "%r s; a stable substep is below %r s",
                          t, h, 2.8 / sqrt(stiffest));
    solver->t = t;
    solver->at = at;
    return true;
}
