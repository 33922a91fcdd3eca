/* A run is a chain of stretches without a change of input or parameters. Each is evaluated from its
 * anchor (a time and a state), never from the step before, so that the result at a communication
 * point does not depend on how the steps in between were cut. */
#include "oscillator_linear.h"

#include <string.h>

/* E[x1, x2] and E[x2] over a time since the anchor. */
struct exponentials {
    struct complex e12, e2;
};

/* Complex displacements z and velocities over 2 pi w whose real parts are meant. */
struct signals {
    struct pair z, w;
};

bool linear_response(const struct linear_solver *solver, double u, struct pair *x,
                     struct report *report)
{
    if (solver->envelope)
        return rotating_phasors(&solver->p, u, solver->centre, x, report);
    return phasors(&solver->p, u, x, report);
}

bool linear_prepare(struct linear_solver *solver, const struct parameters *p, bool envelope,
                    const double offsets[2], struct report *report)
{
    const double u[] = {p->u1, p->u2}, size[] = {p->A1, p->A2}, phase[] = {p->phase1, p->phase2};
    memset(solver, 0, sizeof *solver);
    solver->p = *p;
    solver->envelope = envelope;
    solver->centre = centre_of(p);
    for (int i = 0; i < 2; ++i) {
        struct tone *tone = &solver->tone[solver->tones];
        solver->offsets[i] = offsets[i];
        if (size[i] == 0.0 || (p->g1 == 0.0 && p->g2 == 0.0))
            continue;
        tone->amplitude = c_rect(size[i], phase[i]);
        tone->u = u[i];
        tone->offset = offsets[i];
        tone->frequency = frequency_of(u[i], 0.0);
        if (!linear_response(solver, u[i], &tone->periodic, report))
            return false;
        for (int mode = 0; mode < 2; ++mode)
            tone->periodic.z[mode] = c_multiply(tone->amplitude, tone->periodic.z[mode]);
        ++solver->tones;
    }
    return true;
}

/* The Laplace numerators of unit initial states. */
static int columns_of(const struct linear_solver *solver, struct column columns[MOST_COLUMNS])
{
    const struct precise one = precise_of(1.0, 0.0);
    const struct polynomial zero = polynomial_constant(precise_of(0.0, 0.0));
    const struct polynomial unit = polynomial_constant(one);
    const struct damping w = damping_of(&solver->p);
    const struct polynomial off = polynomial_constant(precise_of(w.w12, 0.0));
    if (solver->envelope) {
        const struct polynomial turning =
            polynomial_constant(precise_of(0.0, 2.0 * solver->centre));
        const struct column rotating[] = {{{turning, zero}}, {{zero, turning}}};
        memcpy(columns, rotating, sizeof rotating);
        return 2;
    } else {
        const struct column full[] = {
            {{polynomial_line(precise_of(w.w11, 0.0), one), off}},
            {{off, polynomial_line(precise_of(w.w22, 0.0), one)}},
            {{unit, zero}},
            {{zero, unit}},
        };
        memcpy(columns, full, sizeof full);
        return 4;
    }
}

/* The coefficients of E[x1, x2] and E[x2] of the motion left to itself. */
static void prepare_free(struct linear_solver *solver)
{
    const double scale = solver->envelope ? 1.0 : 2.0; /* exact: the mirrored poles' conjugate */
    const int count = solver->envelope ? 2 : 4;
    struct state start = solver->state;
    bool still = true;
    memset(solver->own, 0, sizeof solver->own);
    for (int mode = 0; mode < 2; ++mode)
        start.z[mode].re -= solver->at_rest[mode];
    for (int k = 0; k < 4; ++k)
        still = still && c_is_zero(start.z[k]);
    if (still)
        return;
    if (!solver->has_free) {
        struct column columns[MOST_COLUMNS];
        free_part_of(&solver->pencil, columns, columns_of(solver, columns), &solver->free);
        solver->has_free = true;
    }
    for (int k = 0; k < count; ++k) {
        const struct complex value = c_scale(scale, start.z[k]);
        for (int mode = 0; mode < 2; ++mode) {
            struct complex *first = &solver->own[0].z[mode], *second = &solver->own[1].z[mode];
            *first = c_add(*first, c_multiply(value, solver->free.first[k].z[mode]));
            *second = c_add(*second, c_multiply(value, solver->free.second[k].z[mode]));
        }
    }
}

static bool prepare_kernel(struct linear_solver *solver, struct report *report)
{
    if (solver->has_kernel)
        return true;
    if (!(solver->envelope
              ? rotating_pencil(&solver->p, solver->centre, &solver->pencil, report)
              : oscillator_pencil(&solver->p, &solver->pencil, report)))
        return false;
    solver->roots = roots_of(&solver->pencil);
    for (int i = 0; i < solver->tones; ++i)
        if (!tone_kernel_of(&solver->pencil, &solver->p, solver->tone[i].u,
                            &solver->tone[i].kernel, report))
            return false;
    solver->has_kernel = true;
    return true;
}

/* Cycles that a tone has turned at a time. */
static double turned(const struct tone *tone, double t)
{
    return TWO_PI * (frequency_cycles(&tone->frequency, t, 0.0) + tone->offset);
}

/* Fold tones, input and state at the anchor into the coefficients of the exponentials. */
static bool prepare_transient(struct linear_solver *solver, struct report *report)
{
    if (!prepare_kernel(solver, report))
        return false;
    prepare_free(solver);
    memcpy(solver->sum, solver->own, sizeof solver->sum);
    solver->early_until = 0.0;
    for (int i = 0; i < solver->tones; ++i) {
        struct tone *tone = &solver->tone[i];
        const struct tone_kernel *kernel = &tone->kernel;
        const double nearest = fmin(c_abs(kernel->gaps[0]), c_abs(kernel->gaps[1]));
        tone->at_anchor =
            c_multiply(tone->amplitude, c_rect(1.0, turned(tone, solver->anchor)));
        tone->until = CONFLUENT / (TWO_PI * nearest);
        if (tone->until > solver->early_until)
            solver->early_until = tone->until;
        for (int mode = 0; mode < 2; ++mode) {
            tone->periodic.z[mode] = c_multiply(tone->amplitude, kernel->periodic.z[mode]);
            for (int part = 0; part < 2; ++part) {
                const struct complex split =
                    c_multiply(tone->at_anchor, kernel->split[part].z[mode]);
                const struct complex mirror =
                    c_multiply(tone->at_anchor, kernel->mirror[part].z[mode]);
                solver->sum[part].z[mode] =
                    c_add(solver->sum[part].z[mode], c_add(split, c_conjugate(mirror)));
            }
        }
    }
    return true;
}

bool linear_start(struct linear_solver *solver, double t, const struct state *state, double b,
                  struct report *report)
{
    const struct parameters *p = &solver->p;
    const double plus = TWO_PI * p->eta_plus, minus = TWO_PI * p->eta_minus;
    if (b != 0.0 && solver->envelope)
        return refuse(report,
                      "b = %r: the rotating frame of solver 1 (envelope) cannot carry an arbitrary "
                      "input; use solver 0 (exact) or 2 (rk4)",
                      b);
    solver->anchor = t;
    solver->b = b;
    solver->at_rest[0] = b * p->g1 / (plus * plus);
    solver->at_rest[1] = b * p->g2 / (minus * minus);
    solver->in_motion = state != NULL;
    if (state == NULL)
        return true;
    solver->state = *state;
    return prepare_transient(solver, report);
}

bool linear_grows(const struct linear_solver *solver)
{
    return solver->in_motion && (solver->roots.growth1 > 0.0 || solver->roots.growth2 > 0.0);
}

/* --- evaluation ------------------------------------------------------------------------------- */

static struct exponentials exponentials_at(const struct roots *roots, struct span dt)
{
    const double turn1 = TWO_PI * frequency_cycles(&roots->frequency1, dt.high, dt.low);
    const double turn2 = TWO_PI * frequency_cycles(&roots->frequency2, dt.high, dt.low);
    const struct complex e1 = c_rect(exp(roots->growth1 * dt.high), turn1);
    const struct complex e2 = c_rect(exp(roots->growth2 * dt.high), turn2);
    const struct exponentials e = {first_difference(e1, e2, roots->gap, dt.high), e2};
    return e;
}

/* The periodic and the static part. */
static void orbit_at(const struct linear_solver *solver, double t, double q[2])
{
    q[0] = solver->at_rest[0];
    q[1] = solver->at_rest[1];
    for (int i = 0; i < solver->tones; ++i) {
        const struct tone *tone = &solver->tone[i];
        const struct complex turn = c_rect(1.0, turned(tone, t));
        for (int mode = 0; mode < 2; ++mode) {
            const struct complex y = tone->periodic.z[mode];
            q[mode] += y.re * turn.re - y.im * turn.im;
        }
    }
}

/* Add the signals of one tone on its orbit. */
static void add_orbit(const struct tone *tone, double t, struct signals *s)
{
    const struct complex turn = c_rect(1.0, turned(tone, t)), i_u = complex_of(0.0, tone->u);
    for (int mode = 0; mode < 2; ++mode) {
        const struct complex y = c_multiply(tone->periodic.z[mode], turn);
        s->z.z[mode] = c_add(s->z.z[mode], y);
        s->w.z[mode] = c_add(s->w.z[mode], c_multiply(i_u, y));
    }
}

/* Add the signals of the exponentials with coefficients of both modes. */
static void add_transient(const struct pair coefficients[2], const struct roots *roots,
                          const struct exponentials *e, struct signals *s)
{
    const struct complex d12 = c_add(c_multiply(roots->x1, e->e12), e->e2);
    const struct complex d2 = c_multiply(roots->x2, e->e2);
    for (int mode = 0; mode < 2; ++mode) {
        const struct complex a = coefficients[0].z[mode], c = coefficients[1].z[mode];
        s->z.z[mode] = c_add(s->z.z[mode], c_add(c_multiply(a, e->e12), c_multiply(c, e->e2)));
        s->w.z[mode] = c_add(s->w.z[mode], c_add(c_multiply(a, d12), c_multiply(c, d2)));
    }
}

/* Add the signals of a tone that is still close to a pole: one divided difference over all three. */
static void add_confluent(const struct linear_solver *solver, const struct tone *tone,
                          struct span dt, const struct exponentials *e, struct signals *s)
{
    const struct roots *roots = &solver->roots;
    const struct tone_kernel *kernel = &tone->kernel;
    const struct complex d12 = c_add(c_multiply(roots->x1, e->e12), e->e2);
    const struct complex d2 = c_multiply(roots->x2, e->e2);
    const struct complex gaps[] = {kernel->gaps[0], kernel->gaps[1], roots->gap};
    const struct complex values[] = {
        c_rect(1.0, TWO_PI * frequency_cycles(&tone->frequency, dt.high, dt.low)),
        c_add(e->e2, c_multiply(roots->gap, e->e12)),
        e->e2,
    };
    const struct complex e012 = second_difference(gaps, values, dt.high);
    const struct complex d012 = c_add(c_multiply(kernel->node, e012), e->e12);
    for (int mode = 0; mode < 2; ++mode) {
        const struct complex f0 = kernel->confluent[0].z[mode];
        const struct complex f01 = kernel->confluent[1].z[mode];
        const struct complex f012 = kernel->confluent[2].z[mode];
        const struct complex z = c_add(c_add(c_multiply(f0, e012), c_multiply(f01, e->e12)),
                                       c_multiply(f012, e->e2));
        const struct complex w =
            c_add(c_add(c_multiply(f0, d012), c_multiply(f01, d12)), c_multiply(f012, d2));
        s->z.z[mode] = c_add(s->z.z[mode], c_multiply(tone->at_anchor, z));
        s->w.z[mode] = c_add(s->w.z[mode], c_multiply(tone->at_anchor, w));
    }
}

/* The signals while a tone and a pole have not yet come apart in phase. */
static struct signals early(const struct linear_solver *solver, double t, struct span dt)
{
    const struct exponentials e = exponentials_at(&solver->roots, dt);
    struct pair coefficients[2] = {solver->own[0], solver->own[1]};
    struct signals s;
    memset(&s, 0, sizeof s);
    for (int i = 0; i < solver->tones; ++i) {
        const struct tone *tone = &solver->tone[i];
        const bool close = dt.high < tone->until;
        if (close)
            add_confluent(solver, tone, dt, &e, &s);
        else
            add_orbit(tone, t, &s);
        for (int part = 0; part < 2; ++part)
            for (int mode = 0; mode < 2; ++mode) {
                struct complex *sum = &coefficients[part].z[mode];
                if (!close)
                    *sum = c_add(*sum, c_multiply(tone->at_anchor,
                                                  tone->kernel.split[part].z[mode]));
                *sum = c_add(*sum, c_conjugate(c_multiply(tone->at_anchor,
                                                          tone->kernel.mirror[part].z[mode])));
            }
    }
    add_transient(coefficients, &solver->roots, &e, &s);
    return s;
}

void linear_displacement(const struct linear_solver *solver, double t, double q[2])
{
    const struct roots *roots = &solver->roots;
    const struct span dt = span_between(t, solver->anchor);
    struct exponentials e;
    if (solver->in_motion && dt.high < solver->early_until) {
        const struct signals s = early(solver, t, dt);
        q[0] = solver->at_rest[0] + s.z.z[0].re;
        q[1] = solver->at_rest[1] + s.z.z[1].re;
        return;
    }
    orbit_at(solver, t, q);
    if (!solver->in_motion ||
        (roots->growth1 * dt.high < DECAYED && roots->growth2 * dt.high < DECAYED))
        return;
    e = exponentials_at(roots, dt);
    for (int mode = 0; mode < 2; ++mode)
        q[mode] += c_add(c_multiply(solver->sum[0].z[mode], e.e12),
                         c_multiply(solver->sum[1].z[mode], e.e2))
                       .re;
}

static struct signals signals_at(const struct linear_solver *solver, double t)
{
    const struct span dt = span_between(t, solver->anchor);
    struct signals s;
    if (solver->in_motion && dt.high < solver->early_until)
        return early(solver, t, dt);
    memset(&s, 0, sizeof s);
    if (solver->in_motion) {
        const struct exponentials e = exponentials_at(&solver->roots, dt);
        add_transient(solver->sum, &solver->roots, &e, &s);
    }
    for (int i = 0; i < solver->tones; ++i)
        add_orbit(&solver->tone[i], t, &s);
    return s;
}

struct state linear_state(const struct linear_solver *solver, double t)
{
    const struct signals s = signals_at(solver, t);
    struct state state = {{s.z.z[0], s.z.z[1], {0.0, 0.0}, {0.0, 0.0}}};
    if (solver->envelope)
        return state;
    for (int mode = 0; mode < 2; ++mode) {
        state.z[mode] = complex_of(solver->at_rest[mode] + s.z.z[mode].re, 0.0);
        state.z[2 + mode] = complex_of(s.w.z[mode].re, 0.0);
    }
    return state;
}
