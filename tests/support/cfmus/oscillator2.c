/* The test oscillator as an FMI 2.0 co-simulation FMU. */
#include "fmi2Functions.h"
#include "model.h"

#ifdef ONLY_ONE_INSTANCE
static int instances;
#endif

static void say(Model *m, fmi2Status status, const char *format, double value) {
    if (m->logger)
        ((fmi2CallbackLogger)m->logger)(m->environment, "oscillator", status, "log", format, value);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return "2.0"; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) {
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                              fmi2Boolean logging) {
    Model *m;
#ifdef ONLY_ONE_INSTANCE
    if (instances++) return NULL;
#endif
    m = model_new();
    m->logger = (void *)functions->logger;
    m->environment = functions->componentEnvironment;
    return m;
}
void fmi2FreeInstance(fmi2Component c) {
#ifdef CRASHES_WHEN_FREED
    model_crash();
#endif
#ifdef HANGS_WHEN_FREED /* and tells so in a file of that name */
    fclose(fopen(HANGS_WHEN_FREED, "w")), model_hang();
#endif
    free(c);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean t, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean s, fmi2Real stop) {
    ((Model *)c)->time = start;
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    Model *m = c;
    if (m->reals[MASS] <= 0) {
        say(m, fmi2Error, "mass = %g kg, wanted a positive mass", m->reals[MASS]);
        return fmi2Error;
    }
    if (m->misbehave == FAILS_AT_START) {
        say(m, fmi2Error, "told to fail: misbehave = %g", m->misbehave);
        return fmi2Error;
    }
    if (m->misbehave == HANGS_AT_START) model_hang();
    return fmi2OK;
}
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    model_initialise(c, ((Model *)c)->time);
    return fmi2OK;
}
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { return model_reset(c); }

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real at, fmi2Real step, fmi2Boolean no_set) {
    Model *m = c;
    model_befall(m);
    switch (m->misbehave) {
    case HANGS: model_hang(); break;
    case CRASHES: say(m, fmi2Warning, "about to crash at %g s", at), model_crash(); break;
    case FAILS_IN_STEP: say(m, fmi2Error, "cannot step from %g s", at); return fmi2Error;
    case ENDS_EARLY: model_step(m, step / 2); return fmi2Discard;
    case IS_PENDING: return fmi2Pending;
    case WARNS: say(m, fmi2Warning, "slow today, %g %% load", 99.0); break;
    case NAN_OUTPUT: say(m, fmi2Warning, "lost the state after %g s", at); break;
    case PRINTS_AND_ABORTS: fprintf(stderr, "assertion of the solver failed\n"), abort();
    }
    model_step(m, step);
    return m->misbehave == WARNS ? fmi2Warning : fmi2OK;
}
fmi2Status fmi2CancelStep(fmi2Component c) { return fmi2Error; }

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    for (size_t i = 0; i < n; i++) value[i] = ((Model *)c)->reals[vr[i]];
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                       const fmi2Real value[]) {
    for (size_t i = 0; i < n; i++) ((Model *)c)->reals[vr[i]] = value[i];
    return fmi2OK;
}
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          fmi2Integer value[]) {
    Model *m = c;
    for (size_t i = 0; i < n; i++) value[i] = vr[i] == STEPS ? m->steps : m->misbehave;
    return fmi2OK;
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          const fmi2Integer value[]) {
    for (size_t i = 0; i < n; i++) ((Model *)c)->misbehave = value[i];
    return fmi2OK;
}
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          fmi2Boolean value[]) {
    for (size_t i = 0; i < n; i++) value[i] = ((Model *)c)->inverted;
    return fmi2OK;
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                          const fmi2Boolean value[]) {
    for (size_t i = 0; i < n; i++) ((Model *)c)->inverted = value[i];
    return fmi2OK;
}
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                         fmi2String value[]) {
    for (size_t i = 0; i < n; i++) value[i] = ((Model *)c)->label;
    return fmi2OK;
}
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                         const fmi2String value[]) {
    Model *m = c;
    for (size_t i = 0; i < n; i++) snprintf(m->label, sizeof m->label, "%s", value[i]);
    return fmi2OK;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    *value = ((Model *)c)->time;
    return kind == fmi2LastSuccessfulTime ? fmi2OK : fmi2Discard;
}
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind k, fmi2Status *v) {
    return fmi2Discard;
}
fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind k, fmi2Integer *v) {
    return fmi2Discard;
}
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind k, fmi2Boolean *v) {
    return fmi2Discard;
}
fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind k, fmi2String *v) {
    return fmi2Discard;
}
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *s) { return fmi2Error; }
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate s) { return fmi2Error; }
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *s) { return fmi2Error; }
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate s, size_t *n) {
    return fmi2Error;
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate s, fmi2Byte b[], size_t n) {
    return fmi2Error;
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte b[], size_t n, fmi2FMUstate *s) {
    return fmi2Error;
}
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference u[], size_t nu,
                                        const fmi2ValueReference k[], size_t nk,
                                        const fmi2Real dk[], fmi2Real du[]) {
    return fmi2Error;
}
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer o[], const fmi2Real v[]) {
    return fmi2Error;
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer o[], fmi2Real v[]) {
    return fmi2Error;
}
