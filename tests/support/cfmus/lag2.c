/* A first-order lag, tau x' + x = gain u, y = x + through u, with u held over a step, as an FMI 2.0
   co-simulation FMU; with WALL the wall between two rooms, C T' = (Ti1 - T)/R1 + (Ti2 - T)/R2. Exact steps; with euler > 0 steps of Euler's method, as long as the communication
   steps are, so that what a trace is off by hangs on these. */
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
#else
enum { TAU, GAIN, THROUGH, START, EULER, U, Y, N_REALS };

static void usual(double *r) { r[TAU] = r[GAIN] = 1; }
static double tau(const double *r) { return r[TAU]; }
static double rest(const double *r) { return r[GAIN] * r[U]; }
static double through(const double *r) { return r[THROUGH] * r[U]; }
#endif

typedef struct {
    double reals[N_REALS], x;
} Lag;

static void start_values(Lag *m) {
    for (int i = 0; i < N_REALS; i++) m->reals[i] = 0;
    usual(m->reals);
    m->x = m->reals[START];
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return "2.0"; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) {
    return fmi2OK;
}
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                              fmi2Boolean logging) {
    Lag *m = malloc(sizeof *m);
    start_values(m);
    return m;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean t, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean s, fmi2Real stop) {
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    Lag *m = c;
    m->x = m->reals[START];
    return fmi2OK;
}
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) {
    start_values(c);
    return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real at, fmi2Real step, fmi2Boolean no_set) {
    Lag *m = c;
    double end = rest(m->reals), past = step / tau(m->reals);
    double left = m->reals[EULER] > 0 ? 1 - past : exp(-past);
    m->x = end + (m->x - end) * left;
    return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    Lag *m = c;
    m->reals[Y] = m->x + through(m->reals);
    for (size_t i = 0; i < n; i++) value[i] = m->reals[vr[i]];
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                       const fmi2Real value[]) {
    for (size_t i = 0; i < n; i++) ((Lag *)c)->reals[vr[i]] = value[i];
    return fmi2OK;
}

#include "absent2.h"
