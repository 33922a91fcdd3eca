/* The oscillator with steps of its own as an FMI 3.0 co-simulation FMU. */
#include "fmi3FunctionTypes.h"
#include "fmi3PlatformTypes.h"
#include "own_step.h"

const char *fmi3GetVersion(void) { return "3.0"; }

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                         fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events,
                                         fmi3Boolean early, const fmi3ValueReference required[],
                                         size_t n, fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
    Model *m = malloc(sizeof *m);
    start_values(m);
    return m;
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean t, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean s, fmi3Float64 stop) {
    ((Model *)c)->start = start;
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance c) { return fmi3OK; }
fmi3Status fmi3Reset(fmi3Instance c) {
    start_values(c);
    return fmi3OK;
}
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 at, fmi3Float64 step, fmi3Boolean no_set,
                      fmi3Boolean *events, fmi3Boolean *terminate, fmi3Boolean *early,
                      fmi3Float64 *reached) {
    *events = *terminate = *early = 0;
    *reached = at + step;
    return model_step(c, at, step) ? fmi3Error : fmi3OK;
}
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 value[],
                          size_t nv) {
    for (size_t i = 0; i < n; i++) value[i] = model_get(c, vr[i]);
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
