/* A first-order lag, tau x' + x = gain u, y = x + through u, with u held over a step, as an FMI 2.0
   co-simulation FMU. Exact steps; with euler > 0 steps of Euler's method, as long as the communication
   steps are, so that what a trace is off by hangs on these. */
#include "fmi2Functions.h"
#include <math.h>
#include <stdlib.h>

enum { TAU, GAIN, THROUGH, START, EULER, U, Y, N_REALS };

typedef struct {
    double reals[N_REALS], x;
} Lag;

static void start_values(Lag *m) {
    m->reals[TAU] = m->reals[GAIN] = 1;
    m->reals[THROUGH] = m->reals[START] = m->reals[EULER] = m->reals[U] = m->reals[Y] = 0;
    m->x = 0;
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
    double rest = m->reals[GAIN] * m->reals[U], past = step / m->reals[TAU];
    double left = m->reals[EULER] > 0 ? 1 - past : exp(-past);
    m->x = rest + (m->x - rest) * left;
    return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    Lag *m = c;
    m->reals[Y] = m->x + m->reals[THROUGH] * m->reals[U];
    for (size_t i = 0; i < n; i++) value[i] = m->reals[vr[i]];
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                       const fmi2Real value[]) {
    for (size_t i = 0; i < n; i++) ((Lag *)c)->reals[vr[i]] = value[i];
    return fmi2OK;
}

#include "absent2.h"
