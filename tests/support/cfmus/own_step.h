/* A driven oscillator, x'' + g x' + w0^2 x = w0^2 (a cos 2 pi f t + u), that advances in steps of its own,
   with the force held over each at its value in the middle. KIND, chosen when compiled, tells how:
   STANDS_BETWEEN makes all whole steps that fit before the end of a communication step, and stands
   between them; LOSES_TIME makes those that fit into each communication step and forgets the rest;
   REFUSES takes communication steps of whole steps alone; LATE_CLOCK is the first with steps that are
   longer than it tells by a part of 1e-3, UNEVEN with steps of many lengths; FOLLOWS has no step of its own, and makes one step of Euler's
   method (semi-implicit) in each communication step. */
#include <math.h>
#include <stdlib.h>

enum { STANDS_BETWEEN, LOSES_TIME, REFUSES, LATE_CLOCK, UNEVEN, FOLLOWS };
enum { TONE, LEVEL, EIGENFREQUENCY, LINE_WIDTH, GAIN, FORCE, DISPLACEMENT, N_REALS };
#ifndef KIND
#define KIND STANDS_BETWEEN
#endif
#ifndef STEP
#define STEP 1e-3
#endif

typedef struct {
    double reals[N_REALS], x, v, start;
    long long steps;
    double time;
} Model;

static void start_values(Model *m) {
    const double reals[N_REALS] = {30, 1, 31, 2, 1, 0, 0};
    for (int i = 0; i < N_REALS; i++) m->reals[i] = reals[i];
    m->x = m->v = m->start = m->time = 0, m->steps = 0;
}

static double force_at(const Model *m, double t) {
    const double pi = 3.14159265358979323846;
    return m->reals[GAIN] * m->reals[LEVEL] * cos(2 * pi * m->reals[TONE] * t) + m->reals[FORCE];
}

/* the closed solution under a constant force; s is the square of the damped frequency, of either sign */
static void inner_step(Model *m, double h, double force) {
    const double pi = 3.14159265358979323846;
    double w0 = 2 * pi * m->reals[EIGENFREQUENCY], g = pi * m->reals[LINE_WIDTH], left = exp(-g * h);
    double s = w0 * w0 - g * g, w = sqrt(fabs(s)), c = 1, d = h, x = m->x - force, v = m->v;
    if (s > 0) c = cos(w * h), d = sin(w * h) / w;
    if (s < 0) c = cosh(w * h), d = sinh(w * h) / w;
    m->x = force + left * (x * (c + g * d) + v * d);
    m->v = left * (v * (c - g * d) - x * w0 * w0 * d);
}

static void euler_step(Model *m, double h) {
    const double pi = 3.14159265358979323846;
    double w0 = 2 * pi * m->reals[EIGENFREQUENCY], g = pi * m->reals[LINE_WIDTH];
    m->v += h * (w0 * w0 * (force_at(m, m->time) - m->x) - 2 * g * m->v);
    m->x += h * m->v;
}

/* 0, or 3 for a step that is refused */
static int model_step(Model *m, double at, double step) {
    double length = KIND == LATE_CLOCK ? STEP * (1 + 1e-3) : STEP, count = step / length;
    long long until;
    if (KIND == FOLLOWS) {
        m->time = at, euler_step(m, step);
        return 0;
    }
    if (KIND == REFUSES && fabs(count - rint(count)) > 1e-6 * count) return 3;
    if (KIND == LOSES_TIME || KIND == REFUSES)
        until = m->steps + (long long)floor(count + 1e-6);
    else
        until = (long long)floor((at + step - m->start) / length + 1e-6);
    for (; KIND == UNEVEN;) {
        double h = STEP * (1 + 0.5 * sin(1e4 * m->steps));
        if (m->time + h > at + step - m->start) return 0;
        inner_step(m, h, force_at(m, m->start + m->time + h / 2));
        m->time += h, m->steps++;
    }
    for (; m->steps < until; m->steps++)
        inner_step(m, length, force_at(m, m->start + (m->steps + 0.5) * length));
    return 0;
}

static void model_begin(Model *m, double start) { m->start = start; }

static void model_initialise(Model *m) {}

static double model_get(Model *m, unsigned which) {
    m->reals[DISPLACEMENT] = m->x;
    return m->reals[which];
}

#include "kept.h"
