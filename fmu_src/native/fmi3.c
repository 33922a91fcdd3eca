/* The interface of FMI 3.0 for co-simulation, over slave.c: the same core as that of FMI 2.0, the
 * same numbers. Here a call that fails says so by its status. */
#include <fmi3Functions.h>
#include <stdlib.h>
#include <string.h>

#include "identity.h"
#include "slave.h"
#include "stored.h"

/* The independent variable, which FMI 3.0 wants among the others, comes after them. */
enum { TIME = VARIABLE_COUNT };

struct instance {
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    struct slave slave;
};

static void tell(const struct instance *instance, fmi3Status status, const char *category,
                 const char *text)
{
    if (instance->log != NULL)
        instance->log(instance->environment, status, category, text);
}

/* Send what a call had to say, and return its status. */
static fmi3Status tell_all(const struct instance *instance, const struct report *report)
{
    for (int i = 0; i < report->warnings; ++i)
        tell(instance, fmi3Warning, "logStatusWarning", report->warning[i].text);
    if (!report->refusal.text[0])
        return fmi3OK;
    tell(instance, fmi3Error, "logStatusError", report->refusal.text);
    return fmi3Error;
}

/* A report with nothing in it; its texts need no zeros beyond the first. */
static void clear(struct report *report)
{
    report->refusal.text[0] = '\0';
    report->warnings = 0;
}

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

/* FMI wants to be told why there is no instance. */
static fmi3Instance no_instance(fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                const char *why)
{
    if (log != NULL)
        log(environment, fmi3Error, "logStatusError", why);
    return NULL;
}

/* What is left of a failure that an earlier call has told of. */
static fmi3Status unless_failed(const struct instance *instance, fmi3Status status)
{
    return instance->slave.phase == FAILED ? fmi3Error : status;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
    const fmi3ValueReference intermediate[], size_t intermediate_count,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3IntermediateUpdateCallback update)
{
    struct instance *instance;
    (void)name;
    (void)resources;
    (void)visible;
    (void)logging; /* warnings and errors are no debug messages: they are always sent */
    (void)early_return;
    (void)intermediate;
    (void)update;
    if (token == NULL || strcmp(token, model_guid) != 0)
        return no_instance(environment, log, "this instantiation token is that of another FMU");
    if (event_mode)
        return no_instance(environment, log, "this FMU has no event mode");
    if (intermediate_count > 0)
        return no_instance(environment, log, "this FMU has no intermediate updates");
    instance = calloc(1, sizeof *instance);
    if (instance == NULL)
        return no_instance(environment, log, "there is no memory left");
    instance->environment = environment;
    instance->log = log;
    slave_start(&instance->slave);
    return instance;
}

void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t count,
                               const fmi3String categories[])
{
    (void)instance;
    (void)on;
    (void)count;
    (void)categories;
    return fmi3OK;
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance handle, fmi3Boolean with_tolerance,
                                       fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean with_stop, fmi3Float64 stop)
{
    struct instance *instance = handle;
    (void)with_tolerance;
    (void)tolerance;
    (void)with_stop;
    (void)stop;
    instance->slave.time = start;
    slave_enter_initialisation(&instance->slave);
    return unless_failed(instance, fmi3OK);
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance handle)
{
    struct instance *instance = handle;
    struct report report;
    clear(&report);
    slave_exit_initialisation(&instance->slave, &report);
    return unless_failed(instance, tell_all(instance, &report));
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    (void)instance;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance handle)
{
    struct instance *instance = handle;
    slave_start(&instance->slave);
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance handle, fmi3Float64 t, fmi3Float64 step, fmi3Boolean no_return,
                      fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early,
                      fmi3Float64 *last)
{
    struct instance *instance = handle;
    struct report report;
    (void)no_return;
    clear(&report);
    slave_step(&instance->slave, t, step, &report);
    *event = *terminate = *early = fmi3False;
    *last = instance->slave.time;
    return unless_failed(instance, tell_all(instance, &report));
}

/* --- get and set ------------------------------------------------------------------------------ */

static fmi3Status get(struct instance *instance, enum kind kind, const unsigned *references,
                      size_t count, double *values)
{
    struct report report;
    clear(&report);
    slave_get(&instance->slave, kind, references, count, values, &report);
    return tell_all(instance, &report);
}

static fmi3Status set(struct instance *instance, enum kind kind, const unsigned *references,
                      size_t count, const double *values)
{
    struct report report;
    clear(&report);
    slave_set(&instance->slave, kind, references, count, values, &report);
    return tell_all(instance, &report);
}

/* Scalars have as many values as references. */
static bool fits(const struct instance *instance, size_t references, size_t values)
{
    if (references == values)
        return true;
    tell(instance, fmi3Error, "logStatusError",
         "get or set: wanted are as many values as value references");
    return false;
}

fmi3Status fmi3GetFloat64(fmi3Instance handle, const fmi3ValueReference references[], size_t count,
                          fmi3Float64 values[], size_t value_count)
{
    struct instance *instance = handle;
    bool timed = false;
    fmi3Status status = fmi3OK;
    if (!fits(instance, count, value_count))
        return fmi3Error;
    for (size_t i = 0; i < count; ++i)
        timed = timed || references[i] == TIME;
    if (!timed)
        return get(instance, REAL, references, count, values);
    for (size_t i = 0; i < count && status == fmi3OK; ++i) {
        values[i] = instance->slave.time;
        if (references[i] != TIME)
            status = get(instance, REAL, references + i, 1, values + i);
    }
    return status;
}

fmi3Status fmi3SetFloat64(fmi3Instance handle, const fmi3ValueReference references[], size_t count,
                          const fmi3Float64 values[], size_t value_count)
{
    return fits(handle, count, value_count) ? set(handle, REAL, references, count, values)
                                            : fmi3Error;
}

fmi3Status fmi3GetInt32(fmi3Instance handle, const fmi3ValueReference references[], size_t count,
                        fmi3Int32 values[], size_t value_count)
{
    double part[CHUNK];
    fmi3Status status = fits(handle, count, value_count) ? fmi3OK : fmi3Error;
    for (size_t i = 0; i < count && status == fmi3OK; i += CHUNK) {
        const size_t size = count - i < CHUNK ? count - i : CHUNK;
        status = get(handle, INTEGER, references + i, size, part);
        for (size_t k = 0; k < size; ++k)
            values[i + k] = (fmi3Int32)part[k];
    }
    return status;
}

fmi3Status fmi3SetInt32(fmi3Instance handle, const fmi3ValueReference references[], size_t count,
                        const fmi3Int32 values[], size_t value_count)
{
    double part[CHUNK];
    fmi3Status status = fits(handle, count, value_count) ? fmi3OK : fmi3Error;
    for (size_t i = 0; i < count && status == fmi3OK; i += CHUNK) {
        const size_t size = count - i < CHUNK ? count - i : CHUNK;
        for (size_t k = 0; k < size; ++k)
            part[k] = values[i + k];
        status = set(handle, INTEGER, references + i, size, part);
    }
    return status;
}

fmi3Status fmi3GetBoolean(fmi3Instance handle, const fmi3ValueReference references[], size_t count,
                          fmi3Boolean values[], size_t value_count)
{
    double part[CHUNK];
    fmi3Status status = fits(handle, count, value_count) ? fmi3OK : fmi3Error;
    for (size_t i = 0; i < count && status == fmi3OK; i += CHUNK) {
        const size_t size = count - i < CHUNK ? count - i : CHUNK;
        status = get(handle, BOOLEAN, references + i, size, part);
        for (size_t k = 0; k < size; ++k)
            values[i + k] = part[k] != 0.0;
    }
    return status;
}

fmi3Status fmi3SetBoolean(fmi3Instance handle, const fmi3ValueReference references[], size_t count,
                          const fmi3Boolean values[], size_t value_count)
{
    double part[CHUNK];
    fmi3Status status = fits(handle, count, value_count) ? fmi3OK : fmi3Error;
    for (size_t i = 0; i < count && status == fmi3OK; i += CHUNK) {
        const size_t size = count - i < CHUNK ? count - i : CHUNK;
        for (size_t k = 0; k < size; ++k)
            part[k] = values[i + k];
        status = set(handle, BOOLEAN, references + i, size, part);
    }
    return status;
}

fmi3Status fmi3GetString(fmi3Instance handle, const fmi3ValueReference references[], size_t count,
                         fmi3String values[], size_t value_count)
{
    struct instance *instance = handle;
    fmi3Status status = fits(instance, count, value_count) ? fmi3OK : fmi3Error;
    double none;
    for (size_t i = 0; i < count && status == fmi3OK; ++i) {
        const bool known = slave_knows(STRING, references[i]);
        values[i] = known ? instance->slave.message.text : "";
        if (!known)
            status = get(instance, STRING, references + i, 1, &none);
    }
    return status;
}

fmi3Status fmi3SetString(fmi3Instance handle, const fmi3ValueReference references[], size_t count,
                         const fmi3String values[], size_t value_count)
{
    struct instance *instance = handle;
    const double other = 1.0;
    fmi3Status status = fits(instance, count, value_count) ? fmi3OK : fmi3Error;
    for (size_t i = 0; i < count && status == fmi3OK; ++i)
        if (!slave_says(&instance->slave, references[i], values[i]))
            status = set(instance, STRING, references + i, 1, &other);
    return status;
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance handle, const fmi3ValueReference unknowns[],
                                        size_t unknown_count, const fmi3ValueReference knowns[],
                                        size_t known_count, const fmi3Float64 seed[],
                                        size_t seed_count, fmi3Float64 sensitivity[],
                                        size_t sensitivity_count)
{
    struct instance *instance = handle;
    struct report report;
    if (!fits(instance, known_count, seed_count) ||
        !fits(instance, unknown_count, sensitivity_count))
        return fmi3Error;
    clear(&report);
    if (slave_derivative(&instance->slave, unknowns, unknown_count, knowns, known_count, seed,
                         sensitivity, &report))
        return tell_all(instance, &report);
    tell_all(instance, &report);
    return fmi3Discard; /* no failure of the simulation */
}

/* --- state ------------------------------------------------------------------------------------ */

fmi3Status fmi3GetFMUState(fmi3Instance handle, fmi3FMUState *state)
{
    struct instance *instance = handle;
    struct report report;
    clear(&report);
    slave_settle(&instance->slave, &report);
    if (tell_all(instance, &report) != fmi3OK)
        return fmi3Error;
    if (*state == NULL)
        *state = malloc(STATE_SIZE);
    if (*state == NULL)
        return fmi3Error;
    memcpy(*state, &instance->slave, STATE_SIZE);
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance handle, fmi3FMUState state)
{
    struct instance *instance = handle;
    if (state == NULL)
        return fmi3Error;
    memcpy(&instance->slave, state, STATE_SIZE);
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    (void)instance;
    if (state != NULL) {
        free(*state);
        *state = NULL;
    }
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size)
{
    (void)instance;
    (void)state;
    *size = stored_size();
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[],
                                 size_t size)
{
    (void)instance;
    if (state == NULL || size < stored_size())
        return fmi3Error;
    store(state, bytes);
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance handle, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState *state)
{
    const struct instance *instance = handle;
    if (!is_stored(bytes, size)) {
        tell(instance, fmi3Error, "logStatusError",
             "deserializeFMUState: these bytes are no state of this FMU, or were changed");
        return fmi3Error;
    }
    if (*state == NULL)
        *state = malloc(STATE_SIZE);
    if (*state == NULL)
        return fmi3Error;
    memcpy(*state, stored_state(bytes), STATE_SIZE);
    return fmi3OK;
}
