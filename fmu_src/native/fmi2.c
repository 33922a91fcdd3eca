/* The interface of FMI 2.0 for co-simulation, over slave.c. An instance is one piece of memory, got
 * when it is made; nothing is shared between instances. */
#include <fmi2Functions.h>
#include <stdlib.h>
#include <string.h>

#include "identity.h"
#include "slave.h"
#include "stored.h"

enum { NAME_LENGTH = 256 };

struct instance {
    fmi2CallbackFunctions callbacks;
    char name[NAME_LENGTH];
    struct slave slave;
};

static void tell(const struct instance *instance, fmi2Status status, const char *category,
                 const char *text)
{
    if (instance->callbacks.logger != NULL)
        instance->callbacks.logger(instance->callbacks.componentEnvironment, instance->name,
                                   status, category, text);
}

/* Send what a call had to say. */
static void tell_all(const struct instance *instance, const struct report *report)
{
    for (int i = 0; i < report->warnings; ++i)
        tell(instance, fmi2Warning, "logStatusWarning", report->warning[i].text);
    if (report->refusal.text[0])
        tell(instance, fmi2Error, "logStatusError", report->refusal.text);
}

/* A report with nothing in it; its texts need no zeros beyond the first. */
static void clear(struct report *report)
{
    report->refusal.text[0] = '\0';
    report->warnings = 0;
}

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

/* FMI wants to be told why there is no instance. */
static fmi2Component no_instance(fmi2String name, const fmi2CallbackFunctions *callbacks,
                                 const char *why)
{
    if (callbacks != NULL && callbacks->logger != NULL)
        callbacks->logger(callbacks->componentEnvironment, name ? name : "", fmi2Error,
                          "logStatusError", why);
    return NULL;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid,
                              fmi2String resources, const fmi2CallbackFunctions *callbacks,
                              fmi2Boolean visible, fmi2Boolean logging)
{
    struct instance *instance;
    (void)resources;
    (void)visible;
    (void)logging; /* warnings and errors are no debug messages: they are always sent */
    if (type != fmi2CoSimulation)
        return no_instance(name, callbacks, "fmi2Instantiate: this FMU is for co-simulation alone");
    if (guid == NULL || strcmp(guid, model_guid) != 0)
        return no_instance(name, callbacks, "fmi2Instantiate: this GUID is that of another FMU");
    instance = calloc(1, sizeof *instance);
    if (instance == NULL)
        return no_instance(name, callbacks, "fmi2Instantiate: there is no memory left");
    if (callbacks != NULL)
        instance->callbacks = *callbacks;
    if (name != NULL)
        strncpy(instance->name, name, NAME_LENGTH - 1);
    slave_start(&instance->slave);
    return instance;
}

void fmi2FreeInstance(fmi2Component component)
{
    free(component);
}

fmi2Status fmi2SetDebugLogging(fmi2Component component, fmi2Boolean on, size_t count,
                               const fmi2String categories[])
{
    (void)component;
    (void)on;
    (void)count;
    (void)categories;
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean with_tolerance,
                               fmi2Real tolerance, fmi2Real start, fmi2Boolean with_stop,
                               fmi2Real stop)
{
    struct instance *instance = component;
    (void)with_tolerance;
    (void)tolerance;
    (void)with_stop;
    (void)stop;
    instance->slave.time = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component component)
{
    struct instance *instance = component;
    slave_enter_initialisation(&instance->slave);
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component)
{
    struct instance *instance = component;
    struct report report;
    clear(&report);
    slave_exit_initialisation(&instance->slave, &report);
    tell_all(instance, &report);
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component component)
{
    (void)component;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component component)
{
    struct instance *instance = component;
    slave_start(&instance->slave);
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real t, fmi2Real step, fmi2Boolean no_return)
{
    struct instance *instance = component;
    struct report report;
    bool done;
    (void)no_return;
    clear(&report);
    done = slave_step(&instance->slave, t, step, &report);
    tell_all(instance, &report);
    return done ? fmi2OK : fmi2Discard;
}

fmi2Status fmi2CancelStep(fmi2Component component)
{
    (void)component;
    return fmi2Error; /* no step is ever pending */
}

/* --- get and set ------------------------------------------------------------------------------ */

static void get(struct instance *instance, enum kind kind, const unsigned *references,
                size_t count, double *values)
{
    struct report report;
    clear(&report);
    slave_get(&instance->slave, kind, references, count, values, &report);
    tell_all(instance, &report);
}

static void set(struct instance *instance, enum kind kind, const unsigned *references,
                size_t count, const double *values)
{
    struct report report;
    clear(&report);
    slave_set(&instance->slave, kind, references, count, values, &report);
    tell_all(instance, &report);
}

static void get_whole(struct instance *instance, enum kind kind, const unsigned *references,
                      size_t count, int *values)
{
    double part[CHUNK];
    for (size_t i = 0; i < count; i += CHUNK) {
        const size_t size = count - i < CHUNK ? count - i : CHUNK;
        get(instance, kind, references + i, size, part);
        for (size_t k = 0; k < size; ++k)
            values[i + k] = (int)part[k];
    }
}

static void set_whole(struct instance *instance, enum kind kind, const unsigned *references,
                      size_t count, const int *values)
{
    double part[CHUNK];
    for (size_t i = 0; i < count; i += CHUNK) {
        const size_t size = count - i < CHUNK ? count - i : CHUNK;
        for (size_t k = 0; k < size; ++k)
            part[k] = kind == BOOLEAN ? values[i + k] != 0 : values[i + k];
        set(instance, kind, references + i, size, part);
    }
}

fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference references[],
                       size_t count, fmi2Real values[])
{
    get(component, REAL, references, count, values);
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component component, const fmi2ValueReference references[],
                          size_t count, fmi2Integer values[])
{
    get_whole(component, INTEGER, references, count, values);
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component component, const fmi2ValueReference references[],
                          size_t count, fmi2Boolean values[])
{
    get_whole(component, BOOLEAN, references, count, values);
    return fmi2OK;
}

fmi2Status fmi2GetString(fmi2Component component, const fmi2ValueReference references[],
                         size_t count, fmi2String values[])
{
    struct instance *instance = component;
    double none;
    for (size_t i = 0; i < count; ++i) {
        const bool known = slave_knows(STRING, references[i]);
        values[i] = known ? instance->slave.message.text : "";
        if (!known)
            get(instance, STRING, references + i, 1, &none);
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference references[],
                       size_t count, const fmi2Real values[])
{
    set(component, REAL, references, count, values);
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component component, const fmi2ValueReference references[],
                          size_t count, const fmi2Integer values[])
{
    set_whole(component, INTEGER, references, count, values);
    return fmi2OK;
}

fmi2Status fmi2SetBoolean(fmi2Component component, const fmi2ValueReference references[],
                          size_t count, const fmi2Boolean values[])
{
    set_whole(component, BOOLEAN, references, count, values);
    return fmi2OK;
}

fmi2Status fmi2SetString(fmi2Component component, const fmi2ValueReference references[],
                         size_t count, const fmi2String values[])
{
    struct instance *instance = component;
    const double other = 1.0;
    for (size_t i = 0; i < count; ++i)
        if (!slave_says(&instance->slave, references[i], values[i]))
            set(instance, STRING, references + i, 1, &other);
    return fmi2OK;
}

/* --- state ------------------------------------------------------------------------------------ */

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    struct instance *instance = component;
    struct report report;
    clear(&report);
    slave_settle(&instance->slave, &report);
    tell_all(instance, &report);
    if (*state == NULL)
        *state = malloc(STATE_SIZE);
    if (*state == NULL)
        return fmi2Error;
    memcpy(*state, &instance->slave, STATE_SIZE);
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state)
{
    struct instance *instance = component;
    if (state == NULL)
        return fmi2Error;
    memcpy(&instance->slave, state, STATE_SIZE);
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    (void)component;
    if (state != NULL) {
        free(*state);
        *state = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component component, fmi2FMUstate state, size_t *size)
{
    (void)component;
    (void)state;
    *size = stored_size();
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[],
                                 size_t size)
{
    (void)component;
    if (state == NULL || size < stored_size())
        return fmi2Error;
    store(state, bytes);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *state)
{
    const struct instance *instance = component;
    if (!is_stored(bytes, size)) {
        tell(instance, fmi2Error, "logStatusError",
             "deSerializeFMUstate: these bytes are no state of this FMU, or were changed");
        return fmi2Error;
    }
    if (*state == NULL)
        *state = malloc(STATE_SIZE);
    if (*state == NULL)
        return fmi2Error;
    memcpy(*state, stored_state(bytes), STATE_SIZE);
    return fmi2OK;
}

/* A derivative that there is not is no failure of the simulation: the call is discarded. */
fmi2Status fmi2GetDirectionalDerivative(fmi2Component component,
                                        const fmi2ValueReference unknowns[], size_t unknown_count,
                                        const fmi2ValueReference knowns[], size_t known_count,
                                        const fmi2Real seed[], fmi2Real derivatives[])
{
    struct instance *instance = component;
    struct report report;
    bool done;
    clear(&report);
    done = slave_derivative(&instance->slave, unknowns, unknown_count, knowns, known_count, seed,
                            derivatives, &report);
    tell_all(instance, &report);
    return done ? fmi2OK : fmi2Discard;
}

/* --- what this FMU does not provide, as its description says ----------------------------------- */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component component,
                                       const fmi2ValueReference references[], size_t count,
                                       const fmi2Integer order[], const fmi2Real values[])
{
    (void)component;
    (void)references;
    (void)count;
    (void)order;
    (void)values;
    return fmi2Error;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component component,
                                        const fmi2ValueReference references[], size_t count,
                                        const fmi2Integer order[], fmi2Real values[])
{
    (void)component;
    (void)references;
    (void)count;
    (void)order;
    (void)values;
    return fmi2Error;
}

/* --- status of the last step ------------------------------------------------------------------ */

fmi2Status fmi2GetStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Status *value)
{
    const struct instance *instance = component;
    if (kind != fmi2DoStepStatus)
        return fmi2Discard;
    *value = instance->slave.phase == FAILED ? fmi2Discard : fmi2OK;
    return fmi2OK;
}

fmi2Status fmi2GetRealStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Real *value)
{
    const struct instance *instance = component;
    if (kind != fmi2LastSuccessfulTime)
        return fmi2Discard;
    *value = instance->slave.time;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component component, const fmi2StatusKind kind,
                                fmi2Integer *value)
{
    (void)component;
    (void)kind;
    (void)value;
    return fmi2Discard; /* FMI 2.0 has no status of this type */
}

fmi2Status fmi2GetBooleanStatus(fmi2Component component, const fmi2StatusKind kind,
                                fmi2Boolean *value)
{
    (void)component;
    if (kind != fmi2Terminated)
        return fmi2Discard;
    *value = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component component, const fmi2StatusKind kind,
                               fmi2String *value)
{
    const struct instance *instance = component;
    if (kind != fmi2PendingStatus)
        return fmi2Discard;
    *value = instance->slave.message.text;
    return fmi2OK;
}
