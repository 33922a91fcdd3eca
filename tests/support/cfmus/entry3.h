/* What every test FMU of FMI 3.0 exports alike; a model comes before it. MODEL_EXCHANGE: of that kind
   alone. OWN_START: the FMU has a way of its own to begin. */
#define FMI(NAME) fmi3##NAME
#define OK fmi3OK
#define ERROR fmi3Error
typedef fmi3Instance Instance;
typedef fmi3Status Status;
typedef fmi3Float64 Number;
typedef fmi3Boolean Flag;
#ifndef LISTENS /* what a model does with the logger of its host */
#define LISTENS(M, LOGGER, ENVIRONMENT)
#endif

#include "entry.h"

const char *fmi3GetVersion(void) { return "3.0"; }
#ifdef MODEL_EXCHANGE
fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log) {
#else
fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                         fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events,
                                         fmi3Boolean early, const fmi3ValueReference required[],
                                         size_t n, fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
#endif
    Model *m = model_new();
    if (m) LISTENS(m, log, environment);
    return m;
}
#ifndef OWN_START
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean t, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean s, fmi3Float64 stop) {
    model_begin(c, start);
    return fmi3OK;
}
#endif

/* values of a type: how one is read, and which is set */
#define ACCESS(TYPE, READ, FIELD)                                                                  \
    fmi3Status fmi3Get##TYPE(fmi3Instance c, const fmi3ValueReference vr[], size_t n,              \
                             fmi3##TYPE value[], size_t nv) {                                      \
        Model *m = c;                                                                              \
        if (n != nv) return fmi3Error;                                                             \
        for (size_t i = 0; i < n; i++) value[i] = READ;                                            \
        return fmi3OK;                                                                             \
    }                                                                                              \
    fmi3Status fmi3Set##TYPE(fmi3Instance c, const fmi3ValueReference vr[], size_t n,              \
                             const fmi3##TYPE value[], size_t nv) {                                \
        Model *m = c;                                                                              \
        if (n != nv) return fmi3Error;                                                             \
        for (size_t i = 0; i < n; i++) FIELD = value[i];                                           \
        return fmi3OK;                                                                             \
    }
#ifdef ARRAYS_OF /* the size of a variable: values of several follow each other */
#define WHOLE(VERB, CONST, COPY)                                                                   \
    fmi3Status fmi3##VERB##Float64(fmi3Instance c, const fmi3ValueReference vr[], size_t n,        \
                                   CONST fmi3Float64 value[], size_t nv) {                         \
        Model *m = c;                                                                              \
        size_t at = 0;                                                                             \
        for (size_t i = 0; i < n; i++)                                                             \
            for (size_t k = 0; k < ARRAYS_OF(vr[i]); k++, at++) {                                  \
                if (at >= nv) return fmi3Error;                                                    \
                COPY;                                                                              \
            }                                                                                      \
        return at == nv ? fmi3OK : fmi3Error;                                                      \
    }
WHOLE(Get, , value[at] = m->reals[vr[i]][k])
WHOLE(Set, const, m->reals[vr[i]][k] = value[at])
#else
ACCESS(Float64, model_get(m, vr[i]), m->reals[vr[i]])
#endif
