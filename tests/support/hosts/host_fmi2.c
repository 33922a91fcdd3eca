/* The host's calls in FMI 2.0. */
#include <stdarg.h>
#include <stdlib.h>

#include "fmi2Functions.h"
#include "host.h"

enum { LINE = 4096 };

static fmi2InstantiateTYPE *instantiate;
static fmi2FreeInstanceTYPE *free_instance;
static fmi2SetupExperimentTYPE *setup_experiment;
static fmi2EnterInitializationModeTYPE *enter_initialization;
static fmi2ExitInitializationModeTYPE *exit_initialization;
static fmi2TerminateTYPE *terminate;
static fmi2ResetTYPE *reset;
static fmi2SetRealTYPE *set_real;
static fmi2SetIntegerTYPE *set_integer;
static fmi2SetBooleanTYPE *set_boolean;
static fmi2GetRealTYPE *get_real;
static fmi2GetStringTYPE *get_string;
static fmi2DoStepTYPE *do_step;
static fmi2GetFMUstateTYPE *get_state;
static fmi2SetFMUstateTYPE *set_state;
static fmi2FreeFMUstateTYPE *free_state;
static fmi2SerializedFMUstateSizeTYPE *serialized_size;
static fmi2SerializeFMUstateTYPE *serialize;
static fmi2DeSerializeFMUstateTYPE *deserialize;
static fmi2GetDirectionalDerivativeTYPE *get_derivative;

/* An instance, and the callbacks that the FMU may look at as long as it lives. */
struct held {
    fmi2Component fmu;
    fmi2CallbackFunctions callbacks;
};

static fmi2Component fmu_of(void *instance)
{
    return ((struct held *)instance)->fmu;
}

static void logger(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status,
                   fmi2String category, fmi2String format, ...)
{
    char text[LINE];
    va_list arguments;
    (void)instance;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments); /* hosts read the message as a format */
    va_end(arguments);
    write_log(environment, (int)status, category, text);
}

void fmu_load(void *library)
{
    /* *(void **)& is how POSIX tells to turn dlsym's pointer into one to a function */
#define LOAD(variable, name) *(void **)(&variable) = symbol(library, name)
    LOAD(instantiate, "fmi2Instantiate");
    LOAD(free_instance, "fmi2FreeInstance");
    LOAD(setup_experiment, "fmi2SetupExperiment");
    LOAD(enter_initialization, "fmi2EnterInitializationMode");
    LOAD(exit_initialization, "fmi2ExitInitializationMode");
    LOAD(terminate, "fmi2Terminate");
    LOAD(reset, "fmi2Reset");
    LOAD(set_real, "fmi2SetReal");
    LOAD(set_integer, "fmi2SetInteger");
    LOAD(set_boolean, "fmi2SetBoolean");
    LOAD(get_real, "fmi2GetReal");
    LOAD(get_string, "fmi2GetString");
    LOAD(do_step, "fmi2DoStep");
    LOAD(get_state, "fmi2GetFMUstate");
    LOAD(set_state, "fmi2SetFMUstate");
    LOAD(free_state, "fmi2FreeFMUstate");
    LOAD(serialized_size, "fmi2SerializedFMUstateSize");
    LOAD(serialize, "fmi2SerializeFMUstate");
    LOAD(deserialize, "fmi2DeSerializeFMUstate");
    LOAD(get_derivative, "fmi2GetDirectionalDerivative");
#undef LOAD
}

void *fmu_new(struct session *session, const char *name)
{
    const fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, session};
    struct held *held = calloc(1, sizeof *held);
    if (held == NULL)
        return NULL;
    held->callbacks = callbacks;
    held->fmu = instantiate(name, fmi2CoSimulation, session->token, session->resources,
                            &held->callbacks, fmi2False, fmi2True);
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
    return (int)setup_experiment(fmu_of(instance), fmi2False, 0.0, start, fmi2False, 0.0);
}

int fmu_enter(void *instance)
{
    return (int)enter_initialization(fmu_of(instance));
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
    *last = time + size;
    return (int)do_step(fmu_of(instance), time, size, fmi2True);
}

int fmu_set(void *instance, char kind, unsigned reference, double value)
{
    const int whole = kind == 'r' ? 0 : (int)value;
    if (kind == 'r')
        return (int)set_real(fmu_of(instance), &reference, 1, &value);
    return (int)(kind == 'i' ? set_integer : set_boolean)(fmu_of(instance), &reference, 1, &whole);
}

int fmu_get_reals(void *instance, const unsigned *references, size_t count, double *values)
{
    return (int)get_real(fmu_of(instance), references, count, values);
}

int fmu_get_text(void *instance, unsigned reference, const char **text)
{
    return (int)get_string(fmu_of(instance), &reference, 1, text);
}

int fmu_derivatives(void *instance, const unsigned *unknowns, size_t count, unsigned known,
                    double seed, double *values)
{
    return (int)get_derivative(fmu_of(instance), unknowns, count, &known, 1, &seed, values);
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
    return (int)serialize(fmu_of(instance), state, bytes, size);
}

int fmu_unpack(void *instance, const char *bytes, size_t size, void **state)
{
    return (int)deserialize(fmu_of(instance), bytes, size, state);
}
