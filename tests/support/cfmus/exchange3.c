/* An FMU of FMI 3.0 of model exchange alone. */
#include "fmi3FunctionTypes.h"
#include "fmi3PlatformTypes.h"
#include "exchange.h"

#define MODEL_EXCHANGE
const char *fmi3GetVersion(void) { return "3.0"; }
fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log) {
    Model *m = malloc(sizeof *m);
    start_values(m);
    return m;
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean t, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean s, fmi3Float64 stop) {
    ((Model *)c)->time = start;
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    initialise(c);
    return fmi3OK;
}
fmi3Status fmi3Terminate(fmi3Instance c) { return fmi3OK; }
fmi3Status fmi3Reset(fmi3Instance c) {
    start_values(c);
    return fmi3OK;
}
fmi3Status fmi3EnterEventMode(fmi3Instance c) { return fmi3OK; }
fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c) { return fmi3OK; }
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *needed, fmi3Boolean *end,
                                    fmi3Boolean *nominals, fmi3Boolean *states, fmi3Boolean *defined,
                                    fmi3Float64 *next) {
    *needed = *end = *nominals = *states = 0;
    *defined = 1;
    *next = update(c);
    return fmi3OK;
}
fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean no_set, fmi3Boolean *event,
                                       fmi3Boolean *end) {
    *event = *end = 0;
    return fmi3OK;
}
fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time) {
    ((Model *)c)->time = time;
    return fmi3OK;
}
fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 x[], size_t n) {
    ((Model *)c)->reals[X] = x[0], ((Model *)c)->reals[V] = x[1];
    return fmi3OK;
}
fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n) {
    x[0] = ((Model *)c)->reals[X], x[1] = ((Model *)c)->reals[V];
    return fmi3OK;
}
fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 dx[], size_t n) {
    dx[0] = get(c, V), dx[1] = get(c, DV);
    return fmi3OK;
}
fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 z[], size_t n) {
    z[0] = indicator(c);
    return fmi3OK;
}
fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n) {
    x[0] = x[1] = 1;
    return fmi3OK;
}
fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *n) {
    *n = 2;
    return fmi3OK;
}
fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *n) {
    *n = 1;
    return fmi3OK;
}
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 value[],
                          size_t nv) {
    for (size_t i = 0; i < n; i++) value[i] = get(c, vr[i]);
    return fmi3OK;
}
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                          const fmi3Float64 value[], size_t nv) {
    for (size_t i = 0; i < n; i++) ((Model *)c)->reals[vr[i]] = value[i];
    return fmi3OK;
}

#include "absent3.h"
ABSENT(fmi3GetInt32) ABSENT(fmi3SetInt32) ABSENT(fmi3GetInt64) ABSENT(fmi3SetInt64)
ABSENT(fmi3GetBoolean) ABSENT(fmi3SetBoolean) ABSENT(fmi3SetString)
