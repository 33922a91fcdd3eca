/* The test oscillator as an FMI 3.0 co-simulation FMU. */
#include "fmi3FunctionTypes.h"
#include "fmi3PlatformTypes.h"
#include "model.h"

#define OWN_START
#define OWN_TYPES
#include "entry3.h"

static void say(Model *m, fmi3Status status, const char *text) {
    if (m->logger) ((fmi3LogMessageCallback)m->logger)(m->environment, status, "log", text);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean t, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean s, fmi3Float64 stop) {
    Model *m = c;
    model_begin(m, start);
    if (m->misbehave == FAILS_AT_START) {
        say(m, fmi3Error, "told to fail at the start");
        return fmi3Error;
    }
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 at, fmi3Float64 step, fmi3Boolean no_set,
                      fmi3Boolean *events, fmi3Boolean *terminate, fmi3Boolean *early,
                      fmi3Float64 *reached) {
    Model *m = c;
    model_befall(m);
    *events = *terminate = *early = 0;
    if (m->misbehave == ENDS_EARLY) {
        model_step(m, step / 2);
        *reached = m->time;
        *terminate = 1;
        return fmi3OK;
    }
    if (m->misbehave == FAILS_IN_STEP) {
        say(m, fmi3Error, "cannot make this step");
        return fmi3Error;
    }
    if (m->misbehave == CRASHES) model_crash();
    model_step(m, step);
    /* IS_PENDING stands for a time that tells of half a step, without any flag */
    *reached = m->misbehave == IS_PENDING ? at + step / 2 : at + step;
    return fmi3OK;
}

ACCESS(Int32, m->misbehave, m->misbehave)
ACCESS(Int64, m->steps, m->steps)
ACCESS(Boolean, m->inverted, m->inverted)

fmi3Status fmi3SetString(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                         const fmi3String value[], size_t nv) {
    Model *m = c;
    for (size_t i = 0; i < n; i++) snprintf(m->label, sizeof m->label, "%s", value[i]);
    return fmi3OK;
}

#include "absent3.h"
