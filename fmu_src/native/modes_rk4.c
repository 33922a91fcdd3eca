#include "modes_rk4.h"

#include <string.h>

enum { SUBSTEPS_PER_PERIOD = 40 };

/* cos of the pump and the drive, at one moment. */
struct moment {
    double pump, force;
};

struct rk4_equations rk4_equations_of(const struct parameters *p, const struct matrices *m,
                                      double substep, double fastest_hz, const double offsets[3])
{
    const double square = TWO_PI * TWO_PI;
    struct rk4_equations e;
    double fastest;
    memset(&e, 0, sizeof e);
    e.pumped = pumped(&p->modes);
    e.fastest_hz = fastest_hz;
    fastest = fmax(fastest_hz, e.pumped ? p->modes.pump_hz : 0.0);
    for (int i = 0; i < 2; ++i) /* a tone that is switched off has no frequency */
        fastest = p->size[i] != 0.0 ? fmax(fastest, p->u[i]) : fastest;
    e.substep = substep != 0.0 ? substep : 1.0 / (SUBSTEPS_PER_PERIOD * fastest);
    for (int i = 0; i < MODES; ++i) {
        e.damping[i] = TWO_PI * p->modes.d[i];
        e.g[i] = p->g[i];
        for (int j = 0; j < MODES; ++j) {
            e.stiffness[i][j] = square * real_double(m->stiffness[i][j]);
            e.pump[i][j] = square * m->pump_values[i][j];
        }
    }
    for (int i = 0; i < 2; ++i) {
        if (p->size[i] == 0.0)
            continue;
        e.size[e.tones] = p->size[i];
        e.tone[e.tones] = frequency_of(p->u[i], 0.0);
        e.offset[e.tones++] = offsets[i] + p->phase[i] / TWO_PI;
    }
    e.pump_frequency = frequency_of(p->modes.pump_hz, 0.0);
    e.pump_offset = offsets[2];
    e.pump_cycles = p->pump_phase / TWO_PI;
    return e;
}

static struct moment moment_at(const struct rk4_equations *e, double t)
{
    struct moment now = {0.0, 0.0};
    if (e->pumped)
        now.pump = cos(TWO_PI * (frequency_cycles(&e->pump_frequency, t, 0.0) + e->pump_offset +
                                 e->pump_cycles));
    for (int i = 0; i < e->tones; ++i)
        now.force += e->size[i] *
                     cos(TWO_PI * (frequency_cycles(&e->tone[i], t, 0.0) + e->offset[i]));
    now.force += e->b;
    return now;
}

static void acceleration(const struct rk4_equations *e, const struct moment *now, const double *q,
                         const double *v, double *a)
{
    for (int i = 0; i < MODES; ++i) {
        a[i] = e->g[i] * now->force - e->damping[i] * v[i];
        for (int j = 0; j < MODES; ++j)
            a[i] -= (e->stiffness[i][j] + now->pump * e->pump[i][j]) * q[j];
    }
}

/* One substep of the classical fourth-order method. */
static void substep(const struct rk4_equations *e, double h, const struct moment moments[3],
                    struct rk4_state *state)
{
    static const double weights[] = {2.0, 2.0, 1.0}, parts[] = {0.5, 0.5, 1.0};
    static const int places[] = {1, 1, 2};
    double k[MODES], a[MODES], q[MODES], sum_k[MODES], sum_a[MODES];
    memcpy(k, state->v, sizeof k);
    acceleration(e, &moments[0], state->q, state->v, a);
    memcpy(sum_k, k, sizeof k);
    memcpy(sum_a, a, sizeof a);
    for (int stage = 0; stage < 3; ++stage) {
        const double s = parts[stage] * h;
        for (int i = 0; i < MODES; ++i) {
            q[i] = state->q[i] + s * k[i];
            k[i] = state->v[i] + s * a[i];
        }
        acceleration(e, &moments[places[stage]], q, k, a);
        for (int i = 0; i < MODES; ++i) {
            sum_k[i] += weights[stage] * k[i];
            sum_a[i] += weights[stage] * a[i];
        }
    }
    for (int i = 0; i < MODES; ++i) {
        state->q[i] += h / 6.0 * sum_k[i];
        state->v[i] += h / 6.0 * sum_a[i];
    }
}

bool rk4_advance(const struct rk4_equations *e, struct rk4_state *state, double t,
                 struct report *report)
{
    const double begin = state->t, span = t - begin;
    const double needed = ceil(span / e->substep * (1.0 - 1e-12));
    const double count = needed > 1.0 ? needed : 1.0, h = span / count;
    struct moment moments[3] = {moment_at(e, begin), {0.0, 0.0}, {0.0, 0.0}};
    for (double k = 0.0; k < count; k += 1.0) {
        moments[1] = moment_at(e, begin + (k + 0.5) * h);
        moments[2] = moment_at(e, k + 1.0 < count ? begin + (k + 1.0) * h : t);
        substep(e, h, moments, state);
        moments[0] = moments[2];
    }
    for (int i = 0; i < MODES; ++i)
        if (!isfinite(state->q[i]) || !isfinite(state->v[i]))
            return refuse(report,
                          "the rk4 solution left the range of numbers at t = %r s with substeps of "
                          "%r s; a stable substep is below %r s",
                          t, h, 2.8 / (TWO_PI * e->fastest_hz));
    state->t = t;
    return true;
}
