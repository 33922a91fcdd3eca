/* What every test FMU of FMI 2.0 exports alike; a model comes before it. MODEL_EXCHANGE: of that kind
   alone. OWN_START: the FMU has a way of its own to begin. */
#define FMI(NAME) fmi2##NAME
#define OK fmi2OK
#define ERROR fmi2Error
typedef fmi2Component Instance;
typedef fmi2Status Status;
typedef fmi2Real Number;
typedef fmi2Boolean Flag;
#ifndef LISTENS /* what a model does with the logger of its host */
#define LISTENS(M, LOGGER, ENVIRONMENT)
#endif

#include "entry.h"

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return "2.0"; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) {
    return fmi2OK;
}
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                              fmi2Boolean logging) {
    Model *m;
#ifdef MODEL_EXCHANGE
    if (type != fmi2ModelExchange) return NULL;
#endif
    m = model_new();
    if (m) LISTENS(m, functions->logger, functions->componentEnvironment);
    return m;
}
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean t, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean s, fmi2Real stop) {
    model_begin(c, start);
    return fmi2OK;
}
#ifndef OWN_START
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
#endif

/* values of a type: how one is read, and which is set */
#define ACCESS(TYPE, READ, FIELD)                                                                  \
    fmi2Status fmi2Get##TYPE(fmi2Component c, const fmi2ValueReference vr[], size_t n,             \
                             fmi2##TYPE value[]) {                                                 \
        Model *m = c;                                                                              \
        for (size_t i = 0; i < n; i++) value[i] = READ;                                            \
        return fmi2OK;                                                                             \
    }                                                                                              \
    fmi2Status fmi2Set##TYPE(fmi2Component c, const fmi2ValueReference vr[], size_t n,             \
                             const fmi2##TYPE value[]) {                                           \
        Model *m = c;                                                                              \
        for (size_t i = 0; i < n; i++) FIELD = value[i];                                           \
        return fmi2OK;                                                                             \
    }
ACCESS(Real, model_get(m, vr[i]), m->reals[vr[i]])
