/* The host's calls in FMI 3.0. */
#include <stdbool.h>
#include <stdlib.h>

#include "fmi3Functions.h"
#include "host.h"

static fmi3InstantiateCoSimulationTYPE *instantiate;
static fmi3FreeInstanceTYPE *free_instance;
static fmi3EnterInitializationModeTYPE *enter_initialization;
static fmi3ExitInitializationModeTYPE *exit_initialization;
static fmi3TerminateTYPE *terminate;
static fmi3ResetTYPE *reset;
static fmi3SetFloat64TYPE *set_real;
static fmi3SetInt32TYPE *set_integer;
static fmi3SetBooleanTYPE *set_boolean;
static fmi3GetFloat64TYPE *get_real;
static fmi3GetStringTYPE *get_string;
static fmi3DoStepTYPE *do_step;
static fmi3GetFMUStateTYPE *get_state;
static fmi3SetFMUStateTYPE *set_state;
static fmi3FreeFMUStateTYPE *free_state;
static fmi3SerializedFMUStateSizeTYPE *serialized_size;
static fmi3SerializeFMUStateTYPE *serialize;
static fmi3DeserializeFMUStateTYPE *deserialize;
static fmi3GetDirectionalDerivativeTYPE *get_derivative;

/* An instance, and when it is to start: FMI 3.0 tells so on entering initialisation. */
struct held {
    fmi3Instance fmu;
    double start;
};

static fmi3Instance fmu_of(void *instance)
{
    return ((struct held *)instance)->fmu;
}

static void logger(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category,
                   fmi3String message)
{
    write_log(environment, (int)status, category, message);
}

void fmu_load(void *library)
{
    /* *(void **)& is how POSIX tells to turn dlsym's pointer into one to a function */
#define LOAD(variable, name) *(void **)(&variable) = symbol(library, name)
    LOAD(instantiate, "fmi3InstantiateCoSimulation");
    LOAD(free_instance, "fmi3FreeInstance");
    LOAD(enter_initialization, "fmi3EnterInitializationMode");
    LOAD(exit_initialization, "fmi3ExitInitializationMode");
    LOAD(terminate, "fmi3Terminate");
    LOAD(reset, "fmi3Reset");
    LOAD(set_real, "fmi3SetFloat64");
    LOAD(set_integer, "fmi3SetInt32");
    LOAD(set_boolean, "fmi3SetBoolean");
    LOAD(get_real, "fmi3GetFloat64");
    LOAD(get_string, "fmi3GetString");
    LOAD(do_step, "fmi3DoStep");
    LOAD(get_state, "fmi3GetFMUState");
    LOAD(set_state, "fmi3SetFMUState");
    LOAD(free_state, "fmi3FreeFMUState");
    LOAD(serialized_size, "fmi3SerializedFMUStateSize");
    LOAD(serialize, "fmi3SerializeFMUState");
    LOAD(deserialize, "fmi3DeserializeFMUState");
    LOAD(get_derivative, "fmi3GetDirectionalDerivative");
#undef LOAD
}

void *fmu_new(struct session *session, const char *name)
{
    struct held *held = calloc(1, sizeof *held);
    if (held == NULL)
        return NULL;
    held->fmu = instantiate(name, session->token, session->resources, fmi3False, fmi3True,
                            fmi3False, fmi3False, NULL, 0, session, logger, NULL);
    if (held->fmu != NULL)
        return held;
    free(held);
    return NULL;
}

void fmu_free(void *instance)
{
    free_instance(fmu_of(instance));
    free(instance);
}

int fmu_setup(void *instance, double start)
{
    ((struct held *)instance)->start = start;
    return fmi3OK;
}

int fmu_enter(void *instance)
{
    return (int)enter_initialization(fmu_of(instance), fmi3False, 0.0,
                                     ((struct held *)instance)->start, fmi3False, 0.0);
}

int fmu_exit(void *instance)
{
    return (int)exit_initialization(fmu_of(instance));
}

int fmu_terminate(void *instance)
{
    return (int)terminate(fmu_of(instance));
}

int fmu_reset(void *instance)
{
    return (int)reset(fmu_of(instance));
}

int fmu_step(void *instance, double time, double size, double *last)
{
    fmi3Boolean event, ending, early;
    return (int)do_step(fmu_of(instance), time, size, fmi3True, &event, &ending, &early, last);
}

int fmu_set(void *instance, char kind, unsigned reference, double value)
{
    const fmi3Int32 whole = kind == 'i' ? (fmi3Int32)value : 0;
    const fmi3Boolean truth = value != 0.0;
    if (kind == 'r')
        return (int)set_real(fmu_of(instance), &reference, 1, &value, 1);
    if (kind == 'i')
        return (int)set_integer(fmu_of(instance), &reference, 1, &whole, 1);
    return (int)set_boolean(fmu_of(instance), &reference, 1, &truth, 1);
}

int fmu_get_reals(void *instance, const unsigned *references, size_t count, double *values)
{
    return (int)get_real(fmu_of(instance), references, count, values, count);
}

int fmu_get_text(void *instance, unsigned reference, const char **text)
{
    return (int)get_string(fmu_of(instance), &reference, 1, text, 1);
}

int fmu_derivatives(void *instance, const unsigned *unknowns, size_t count, unsigned known,
                    double seed, double *values)
{
    return (int)get_derivative(fmu_of(instance), unknowns, count, &known, 1, &seed, 1, values,
                               count);
}

int fmu_save(void *instance, void **state)
{
    return (int)get_state(fmu_of(instance), state);
}

int fmu_restore(void *instance, void *state)
{
    return (int)set_state(fmu_of(instance), state);
}

int fmu_drop(void *instance, void **state)
{
    return (int)free_state(fmu_of(instance), state);
}

int fmu_packed_size(void *instance, void *state, size_t *size)
{
    return (int)serialized_size(fmu_of(instance), state, size);
}

int fmu_pack(void *instance, void *state, char *bytes, size_t size)
{
    return (int)serialize(fmu_of(instance), state, (fmi3Byte *)bytes, size);
}

int fmu_unpack(void *instance, const char *bytes, size_t size, void **state)
{
    return (int)deserialize(fmu_of(instance), (const fmi3Byte *)bytes, size, state);
}
