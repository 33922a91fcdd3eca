/* A co-simulation host in C that knows nothing of Python: it replays a script of FMI calls.
 *
 *     replay LIBPYTHON|- FMU_LIBRARY RESOURCE_URI GUID < script > transcript
 *
 * LIBPYTHON is loaded first with its symbols made global, as the documentation of the FMU tells
 * hosts to do ("-" leaves it out). Every line of the script is "verb slot argument...", where slot
 * numbers one of several instances; every call answers with one line "verb slot status value...".
 * Messages to the logger become lines "log status category text". Exit codes: 3 nothing could be
 * loaded, 4 the script is wrong, 5 there is no instance to call.
 */
#include <dlfcn.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

enum { SLOTS = 4, MAX_REFERENCES = 64, LINE = 4096 };

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
static void (*release)(void);

static void logger(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status,
                   fmi2String category, fmi2String format, ...)
{
    char text[LINE];
    va_list arguments;
    (void)environment;
    (void)instance;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments); /* hosts read the message as a format */
    va_end(arguments);
    printf("log %d %s %s\n", (int)status, category ? category : "-", text);
}

static const fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};

static void *symbol(void *library, const char *name)
{
    void *found = dlsym(library, name);
    if (found == NULL) {
        fprintf(stderr, "%s\n", dlerror());
        exit(3);
    }
    return found;
}

static void load(const char *libpython, const char *path)
{
    void *library;
    if (strcmp(libpython, "-") != 0 && dlopen(libpython, RTLD_NOW | RTLD_GLOBAL) == NULL) {
        fprintf(stderr, "%s\n", dlerror());
        exit(3);
    }
    library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (library == NULL) {
        fprintf(stderr, "%s\n", dlerror());
        exit(3);
    }
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
#undef LOAD
    /* only pythonfmu's binary has it */
    *(void **)(&release) = dlsym(library, "finalizePythonInterpreter");
}

static int answer(const char *verb, int slot, fmi2Status status)
{
    return printf("%s %d %d\n", verb, slot, (int)status);
}

/* getr SLOT REFERENCE...: all values in one call, with the digits that give the same double */
static void read_reals(fmi2Component instance, int slot, char *references)
{
    fmi2ValueReference vr[MAX_REFERENCES];
    fmi2Real values[MAX_REFERENCES];
    size_t count = 0;
    char *word;
    for (word = strtok(references, " "); word != NULL && count < MAX_REFERENCES;
         word = strtok(NULL, " "))
        vr[count++] = (fmi2ValueReference)strtoul(word, NULL, 10);
    printf("getr %d %d", slot, (int)get_real(instance, vr, count, values));
    for (size_t i = 0; i < count; ++i)
        printf(" %.17g", values[i]);
    printf("\n");
}

static void assign(const char *verb, fmi2Component instance, int slot, const char *words)
{
    fmi2ValueReference vr = 0;
    double value = 0.0;
    fmi2Status status;
    if (sscanf(words, "%u %lf", &vr, &value) != 2)
        exit(4);
    if (strcmp(verb, "setr") == 0) {
        status = set_real(instance, &vr, 1, &value);
    } else {
        const int whole = (int)value;
        status = strcmp(verb, "seti") == 0 ? set_integer(instance, &vr, 1, &whole)
                                           : set_boolean(instance, &vr, 1, &whole);
    }
    answer(verb, slot, status);
}

/* Return whether the verb was one that changes nothing but the mode of the instance. */
static int change_mode(const char *verb, fmi2Component instance, int slot, const char *words)
{
    if (strcmp(verb, "setup") == 0)
        answer(verb, slot,
               setup_experiment(instance, fmi2False, 0.0, strtod(words, NULL), fmi2False, 0.0));
    else if (strcmp(verb, "enter") == 0)
        answer(verb, slot, enter_initialization(instance));
    else if (strcmp(verb, "exit") == 0)
        answer(verb, slot, exit_initialization(instance));
    else if (strcmp(verb, "terminate") == 0)
        answer(verb, slot, terminate(instance));
    else if (strcmp(verb, "reset") == 0)
        answer(verb, slot, reset(instance));
    else
        return 0;
    return 1;
}

static void call(const char *verb, int slot, char *words, const char *guid, const char *resources)
{
    static fmi2Component instances[SLOTS];
    static fmi2FMUstate states[SLOTS];
    fmi2Component instance = instances[slot];
    if (strcmp(verb, "new") == 0) {
        instances[slot] = instantiate(words, fmi2CoSimulation, guid, resources, &callbacks,
                                      fmi2False, fmi2True);
        answer(verb, slot, instances[slot] == NULL ? fmi2Fatal : fmi2OK);
    } else if (instance == NULL) {
        exit(5);
    } else if (strcmp(verb, "free") == 0) {
        free_instance(instance);
        instances[slot] = NULL;
        answer(verb, slot, fmi2OK);
    } else if (strncmp(verb, "set", 3) == 0 && strlen(verb) == 4) {
        assign(verb, instance, slot, words);
    } else if (strcmp(verb, "getr") == 0) {
        read_reals(instance, slot, words);
    } else if (strcmp(verb, "gets") == 0) {
        const fmi2ValueReference vr = (fmi2ValueReference)strtoul(words, NULL, 10);
        fmi2String text = "";
        const fmi2Status status = get_string(instance, &vr, 1, &text);
        printf("gets %d %d %s\n", slot, (int)status, text);
    } else if (strcmp(verb, "step") == 0) {
        double time = 0.0, size = 0.0;
        if (sscanf(words, "%lf %lf", &time, &size) != 2)
            exit(4);
        answer(verb, slot, do_step(instance, time, size, fmi2True));
    } else if (strcmp(verb, "save") == 0) {
        answer(verb, slot, get_state(instance, &states[slot]));
    } else if (strcmp(verb, "restore") == 0) {
        answer(verb, slot, set_state(instance, states[slot]));
    } else if (strcmp(verb, "drop") == 0) {
        answer(verb, slot, free_state(instance, &states[slot]));
    } else if (!change_mode(verb, instance, slot, words)) {
        exit(4);
    }
}

int main(int count, char **arguments)
{
    char line[LINE];
    if (count != 5) {
        fprintf(stderr, "usage: replay LIBPYTHON|- FMU_LIBRARY RESOURCE_URI GUID < script\n");
        return 4;
    }
    setvbuf(stdout, NULL, _IOLBF, 0); /* what was said before a crash must not be lost */
    load(arguments[1], arguments[2]);
    while (fgets(line, sizeof line, stdin) != NULL) {
        char verb[16];
        int slot = 0, read = 0;
        line[strcspn(line, "\n")] = '\0';
        if (sscanf(line, "%15s %d %n", verb, &slot, &read) < 2 || slot < 0 || slot >= SLOTS)
            return 4;
        call(verb, slot, line + read, arguments[4], arguments[3]);
    }
    printf("end\n");
    if (release != NULL)
        release(); /* or its destructors touch what they have freed, when the process exits */
    return 0;
}
