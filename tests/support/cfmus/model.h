/* One driven oscillator, m x'' + c x' + k x = F, with the force held over a step: exact steps.
   Part of the test FMUs; what they do wrong on purpose is chosen by the parameter `misbehave` and, for
   the reset, by the macro RESET when compiled. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MASS, DAMPING, STIFFNESS, FORCE, DISPLACEMENT, EIGENFREQUENCY, LINE_WIDTH, N_REALS };
enum { MISBEHAVE = 100, STEPS = 101, INVERTED = 200, LABEL = 300 };
enum { GOOD, HANGS, CRASHES, NAN_OUTPUT, ENDS_EARLY, FAILS_AT_START, FAILS_IN_STEP, IS_PENDING,
       WARNS, HANGS_AT_START, PRINTS_AND_ABORTS };
enum { RESET_WORKS, RESET_DOES_NOTHING, RESET_KEEPS_DERIVED, RESET_CRASHES, RESET_FAILS, RESET_HANGS,
       RESET_FREEZES_OUTPUT, RESET_KEEPS_PARAMETERS };
#ifndef RESET
#define RESET RESET_WORKS
#endif

typedef struct {
    double reals[N_REALS];
    int misbehave, steps, inverted, derived, frozen;
    double x, v, time;
    char label[100];
    void *logger, *environment;
} Model;

static const double PI = 3.14159265358979323846;

static void model_start_values(Model *m) {
    const double reals[N_REALS] = {1e-3, 2e-2, 4e3, 0, 0, 0, 0};
    memcpy(m->reals, reals, sizeof reals);
    m->misbehave = m->inverted = 0;
    strcpy(m->label, "oscillator");
}

static void model_states(Model *m) {
    m->x = m->v = m->time = 0;
    m->steps = 0;
}

static void model_output(Model *m) {
    if (m->frozen) return;
    /* so that a test can tell from outside that a flag and a text have arrived */
    m->reals[DISPLACEMENT] = m->inverted || !strcmp(m->label, "upside down") ? -m->x : m->x;
    if (m->misbehave == NAN_OUTPUT && m->time > 0) m->reals[DISPLACEMENT] = NAN;
}

static void model_initialise(Model *m, double start) {
    m->time = start;
    if (!m->derived) {
        m->reals[EIGENFREQUENCY] = sqrt(m->reals[STIFFNESS] / m->reals[MASS]) / (2 * PI);
        m->reals[LINE_WIDTH] = m->reals[DAMPING] / m->reals[MASS] / (2 * PI);
        m->derived = 1;
    }
    model_output(m);
}

/* x(t+h) by the closed solution; s is the square of the damped frequency, of either sign */
static void model_step(Model *m, double h) {
    double w2 = 2 * PI * m->reals[EIGENFREQUENCY], g = PI * m->reals[LINE_WIDTH], s, c, d;
    double rest = m->reals[FORCE] / m->reals[STIFFNESS], x, v;
    w2 *= w2;
    s = w2 - g * g;
    if (s > 0) {
        double w = sqrt(s);
        c = cos(w * h), d = sin(w * h) / w;
    } else if (s < 0) {
        double w = sqrt(-s);
        c = cosh(w * h), d = sinh(w * h) / w;
    } else {
        c = 1, d = h;
    }
    x = m->x - rest, v = m->v;
    m->x = rest + exp(-g * h) * (x * (c + g * d) + v * d);
    m->v = exp(-g * h) * (v * (c - g * d) - x * w2 * d);
    m->time += h;
    m->steps += 1;
    model_output(m);
}

static void model_hang(void) {
    for (volatile int on = 1; on;) {}
}

static void model_crash(void) {
    *(volatile int *)8 = 1;
}

/* OK (0) or error (3), as FMI has it */
static int model_reset(Model *m) {
    switch (RESET) {
    case RESET_DOES_NOTHING: return 0;
    case RESET_KEEPS_DERIVED: {
        double eigenfrequency = m->reals[EIGENFREQUENCY], line_width = m->reals[LINE_WIDTH];
        model_start_values(m), model_states(m);
        m->reals[EIGENFREQUENCY] = eigenfrequency, m->reals[LINE_WIDTH] = line_width;
        return 0;
    }
    case RESET_CRASHES: model_crash(); return 0;
    case RESET_FAILS: return 3;
    case RESET_HANGS: model_hang(); return 0;
    case RESET_FREEZES_OUTPUT: model_start_values(m), model_states(m), m->frozen = 1; return 0;
    case RESET_KEEPS_PARAMETERS: model_states(m), m->derived = 0; return 0;
    default: model_start_values(m), model_states(m), m->derived = 0; return 0;
    }
}

static Model *model_new(void) {
    Model *m = calloc(1, sizeof *m);
    model_start_values(m);
    return m;
}
