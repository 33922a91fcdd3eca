/* A first-order lag, tau x' + x = gain u, y = x + through u, with u held over a step, as an FMI 2.0
   co-simulation FMU; with WALL the wall between two rooms, C T' = (Ti1 - T)/R1 + (Ti2 - T)/R2; with ROOM a heated
   room, C T' = (To - T)/R1 + Q, seen behind the other resistance, Ti = T + R2 Q. Exact steps; with euler > 0 steps
   of Euler's method, as long as the communication steps are, so that what a trace is off by hangs on these. With
   OWN_STEP steps of Euler's method of that length: all that end within a communication step, between which it stands
   still, or with DIVIDES as many of one length, as long at most, as fill it; with HEUN by his method, of second
   order; with REFUSES communication steps have to be whole ones of that length. */
#include "fmi2Functions.h"
#include <math.h>
#include <stdlib.h>

#ifdef WALL
enum { R1, R2, C, START, EULER, U, U2, Y, N_REALS };

static void usual(double *r) {
    r[R1] = r[R2] = 1, r[C] = 3e4;
    r[START] = r[U] = r[U2] = 293;
}
static double tau(const double *r) { return r[C] * r[R1] * r[R2] / (r[R1] + r[R2]); }
static double rest(const double *r) { return (r[U] * r[R2] + r[U2] * r[R1]) / (r[R1] + r[R2]); }
static double through(const double *r) { return 0; }
#elif defined ROOM
enum { R1, R2, C, START, EULER, U, U2, Y, STATE, N_REALS };

static void usual(double *r) {
    r[R1] = 5e-3, r[R2] = 1e-3, r[C] = 1e7;
    r[START] = r[U] = 293;
}
static double tau(const double *r) { return r[C] * r[R1]; }
static double rest(const double *r) { return r[U] + r[R1] * r[U2]; }
static double through(const double *r) { return r[R2] * r[U2]; }
#else
enum { TAU, GAIN, THROUGH, START, EULER, U, Y, N_REALS };

static void usual(double *r) { r[TAU] = r[GAIN] = 1; }
static double tau(const double *r) { return r[TAU]; }
static double rest(const double *r) { return r[GAIN] * r[U]; }
static double through(const double *r) { return r[THROUGH] * r[U]; }
#endif

typedef struct {
    double reals[N_REALS], x;
    long long steps;
} Model;

static void start_values(Model *m) {
    for (int i = 0; i < N_REALS; i++) m->reals[i] = 0;
    usual(m->reals);
    m->x = m->reals[START], m->steps = 0;
}

static void model_begin(Model *m, double start) {}

static void model_initialise(Model *m) { m->x = m->reals[START]; }

static double model_get(Model *m, unsigned which) {
    m->reals[Y] = m->x + through(m->reals);
#ifdef ROOM
    m->reals[STATE] = m->x;
#endif
    return m->reals[which];
}

#include "kept.h"
#include "entry2.h"

#ifdef OWN_STEP
static void advance(Model *m, double at, double step) {
    double length = OWN_STEP;
    long long count = (long long)floor((at + step) / length + 1e-6) - m->steps;
#ifdef DIVIDES
    count = (long long)ceil(step / length - 1e-6), length = step / count;
#endif
    double past = length / tau(m->reals);
#ifdef HEUN
    past -= past * past / 2;
#endif
    for (m->steps += count; count-- > 0;) m->x += past * (rest(m->reals) - m->x);
}
#else
static void advance(Model *m, double at, double step) {
    double end = rest(m->reals), past = step / tau(m->reals);
    double left = m->reals[EULER] > 0 ? 1 - past : exp(-past);
    m->x = end + (m->x - end) * left;
}
#endif

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real at, fmi2Real step, fmi2Boolean no_set) {
#ifdef REFUSES
    if (fabs(step / OWN_STEP - rint(step / OWN_STEP)) > 1e-6) return fmi2Error;
#endif
    advance(c, at, step);
    return fmi2OK;
}

#include "absent2.h"
