/* The test oscillator as an FMI 2.0 co-simulation FMU. */
#include "fmi2Functions.h"
#include "model.h"

#define OWN_START
#define OWN_TYPES
#define OWN_STATUS
#include "entry2.h"

static void say(Model *m, fmi2Status status, const char *format, double value) {
    if (m->logger)
        ((fmi2CallbackLogger)m->logger)(m->environment, "oscillator", status, "log", format, value);
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

ACCESS(Integer, vr[i] == STEPS ? m->steps : m->misbehave, m->misbehave)
ACCESS(Boolean, m->inverted, m->inverted)
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

#include "absent2.h"
