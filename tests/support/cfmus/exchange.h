/* m x'' = force + weight - c x' - k x - hard (|x| - gap)^3 sign x as equations of model exchange, the last
   term beyond the gap alone, without an event; y = x + through force; with `wall` a ball that is thrown back
   elastically at x = 0; `clock` counts whole seconds by time events. */
#include <math.h>
#include <stdlib.h>

enum { MASS, DAMPING, STIFFNESS, WEIGHT, THROUGH, WALL, HEIGHT, FORCE, X, V, DV, Y, CLOCK, HARD, GAP, N_REALS };

typedef struct {
    double reals[N_REALS], time;
} Model;

static void start_values(Model *m) {
    const double reals[N_REALS] = {1e-3, 2e-2, 4e3, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0};
    for (int i = 0; i < N_REALS; i++) m->reals[i] = reals[i];
}

static void model_begin(Model *m, double start) { m->time = start; }

static void model_initialise(Model *m) { m->reals[X] = m->reals[HEIGHT]; }

static double model_get(Model *m, unsigned which) {
    double *r = m->reals;
    const double beyond = fmax(fabs(r[X]) - r[GAP], 0.0);
    const double hard = copysign(r[HARD] * beyond * beyond * beyond, r[X]);
    r[DV] = (r[FORCE] + r[WEIGHT] - r[DAMPING] * r[V] - r[STIFFNESS] * r[X] - hard) / r[MASS];
    r[Y] = r[X] + r[THROUGH] * r[FORCE];
    return r[which];
}

static double indicator(const Model *m) { return m->reals[WALL] > 0 ? m->reals[X] : 1; }

/* at an event; the time of the next one */
static double update(Model *m) {
    if (m->reals[WALL] > 0 && m->reals[X] <= 0 && m->reals[V] < 0) {
        m->reals[V] = -m->reals[V], m->reals[X] = 1e-300;
    }
    m->reals[CLOCK] = floor(m->time + 1e-9);
    return m->reals[CLOCK] + 1;
}

#include "kept.h"
