#include "oscillator_single.h"

#include <string.h>

bool single_response(const struct single_solver *solver, double u, struct pair *x,
                     struct report *report)
{
    const struct parameters *p = &solver->p;
    const struct damping w = damping_of(p);
    const double gain[] = {p->g1, p->g2}, eta[] = {p->eta_plus, p->eta_minus};
    const double width[] = {w.w11, w.w22};
    const int near = solver->near, far = 1 - near;
    struct complex own[2];
    for (int mode = 0; mode < 2; ++mode)
        own[mode] = c_scale(FOUR_PI_SQUARED, complex_of((eta[mode] - u) * (eta[mode] + u),
                                                        u * width[mode]));
    if (c_is_zero(own[near]))
        return refuse(report, "a drive at %r Hz has no steady state: it is on an undamped mode", u);
    x->z[near] = c_divide(complex_of(gain[near], 0.0), own[near]);
    x->z[far] = complex_of(0.0, 0.0);
    if (solver->other == QUASI_STATIC && !c_is_zero(own[far])) {
        const struct complex coupling = complex_of(0.0, FOUR_PI_SQUARED * (u * w.w12));
        const struct complex force =
            c_subtract(complex_of(gain[far], 0.0), c_multiply(coupling, x->z[near]));
        x->z[far] = c_divide(force, own[far]);
    }
    return true;
}

bool single_prepare(struct single_solver *solver, const struct parameters *p, int other,
                    const double offsets[2], struct report *report)
{
    const double u[] = {p->u1, p->u2}, size[] = {p->A1, p->A2}, phase[] = {p->phase1, p->phase2};
    const double centre = centre_of(p);
    const struct damping w = damping_of(p);
    memset(solver, 0, sizeof *solver);
    solver->p = *p;
    solver->other = other;
    solver->near = fabs(p->eta_plus - centre) <= fabs(p->eta_minus - centre) ? 0 : 1;
    solver->decay = PI * (solver->near ? w.w22 : w.w11);
    solver->omega = TWO_PI * (solver->near ? p->eta_minus : p->eta_plus);
    for (int i = 0; i < 2; ++i) {
        struct single_tone *tone = &solver->tone[solver->tones];
        const struct complex amplitude = c_rect(size[i], phase[i]);
        solver->offsets[i] = offsets[i];
        if (size[i] == 0.0)
            continue;
        tone->u = u[i];
        tone->offset = offsets[i];
        tone->frequency = frequency_of(u[i], 0.0);
        if (!single_response(solver, u[i], &tone->periodic, report))
            return false;
        for (int mode = 0; mode < 2; ++mode)
            tone->periodic.z[mode] = c_multiply(amplitude, tone->periodic.z[mode]);
        ++solver->tones;
    }
    return true;
}

static struct complex turn_at(const struct single_tone *tone, double t)
{
    return c_rect(1.0, TWO_PI * (frequency_cycles(&tone->frequency, t, 0.0) + tone->offset));
}

/* The periodic and the static part. */
static void orbit_at(const struct single_solver *solver, double t, double q[2])
{
    q[0] = solver->at_rest[0];
    q[1] = solver->at_rest[1];
    for (int i = 0; i < solver->tones; ++i) {
        const struct complex turn = turn_at(&solver->tone[i], t);
        for (int mode = 0; mode < 2; ++mode)
            q[mode] += c_multiply(solver->tone[i].periodic.z[mode], turn).re;
    }
}

/* The velocity of the near mode's periodic part. */
static double orbit_velocity(const struct single_solver *solver, double t)
{
    double velocity = 0.0;
    for (int i = 0; i < solver->tones; ++i) {
        const struct single_tone *tone = &solver->tone[i];
        const struct complex speed = c_multiply(complex_of(0.0, TWO_PI * tone->u),
                                                tone->periodic.z[solver->near]);
        velocity += c_multiply(speed, turn_at(tone, t)).re;
    }
    return velocity;
}

/* Displacement and velocity of the near mode's damped oscillation. */
static struct complex transient_at(const struct single_solver *solver, double t)
{
    const struct span dt = span_between(t, solver->anchor);
    struct complex turn;
    double x;
    if (!solver->in_motion)
        return complex_of(0.0, 0.0);
    turn = c_rect(exp(-solver->decay * dt.high),
                  TWO_PI * frequency_cycles(&solver->cycles, dt.high, dt.low));
    x = solver->cosine * turn.re + solver->sine * turn.im;
    return complex_of(x, solver->turning * (solver->sine * turn.re - solver->cosine * turn.im) -
                             solver->decay * x);
}

bool single_start(struct single_solver *solver, double t, const struct state *state, double b,
                  struct report *report)
{
    const struct parameters *p = &solver->p;
    const double gain[] = {p->g1, p->g2}, eta[] = {p->eta_plus, p->eta_minus};
    const int near = solver->near, far = 1 - near;
    const double far_omega = TWO_PI * eta[far];
    const double square = (solver->omega - solver->decay) * (solver->omega + solver->decay);
    double q[2];
    solver->anchor = t;
    solver->b = b;
    solver->in_motion = false;
    solver->at_rest[near] = b * gain[near] / (solver->omega * solver->omega);
    solver->at_rest[far] =
        solver->other == QUASI_STATIC ? b * gain[far] / (far_omega * far_omega) : 0.0;
    if (state == NULL)
        return true;
    if (square <= 0.0)
        return refuse(report,
                      "a mode is overdamped (d1 = %r Hz, d2 = %r Hz): use solver 2 (rk4) or "
                      "periodic_start",
                      p->d1, p->d2);
    solver->turning = sqrt(square);
    solver->cycles = frequency_of(solver->turning / TWO_PI, 0.0);
    orbit_at(solver, t, q);
    solver->cosine = state->z[near].re - q[near];
    solver->sine = (TWO_PI * state->z[2 + near].re - orbit_velocity(solver, t) +
                    solver->decay * solver->cosine) /
                   solver->turning;
    solver->in_motion = true;
    return true;
}

bool single_grows(const struct single_solver *solver)
{
    return solver->in_motion && solver->decay < 0.0;
}

void single_displacement(const struct single_solver *solver, double t, double q[2])
{
    orbit_at(solver, t, q);
    q[solver->near] += transient_at(solver, t).re;
}

/* The other mode's velocity counts as 0. */
struct state single_state(const struct single_solver *solver, double t)
{
    struct state state;
    double q[2];
    memset(&state, 0, sizeof state);
    single_displacement(solver, t, q);
    state.z[0].re = q[0];
    state.z[1].re = q[1];
    state.z[2 + solver->near].re =
        (orbit_velocity(solver, t) + transient_at(solver, t).im) / TWO_PI;
    return state;
}
