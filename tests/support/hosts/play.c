/* Replays a script of FMI calls.
 *
 * Every line of the script is "verb slot argument...", where slot numbers one of several instances;
 * every call answers with one line "verb slot status value...". Messages to the logger become lines
 * "log status category text". Where the process has a function allocation_count (allocations.c), a
 * call that got memory answers with one more line "allocated slot how-often verb".
 */
#include <stdlib.h>
#include <string.h>

#include "host.h"

enum { SLOTS = 4, MAX_REFERENCES = 64, LINE = 4096, FATAL = 4, MAX_BYTES = 1 << 18 };

struct slots {
    void *instance[SLOTS], *state[SLOTS];
    char *bytes; /* of the state that was packed last */
    size_t size;
};

void write_log(struct session *session, int status, const char *category, const char *text)
{
    fprintf(session->out, "log %d %s %s\n", status, category ? category : "-", text);
}

static int answer(struct session *session, const char *verb, int slot, int status)
{
    return fprintf(session->out, "%s %d %d\n", verb, slot, status);
}

static void print_reals(struct session *session, const char *verb, int slot, int status,
                        const double *values, size_t count)
{
    fprintf(session->out, "%s %d %d", verb, slot, status);
    for (size_t i = 0; i < count; ++i)
        fprintf(session->out, " %.17g", values[i]); /* the digits that give the same double */
    fprintf(session->out, "\n");
}

static size_t read_references(char *words, unsigned *references)
{
    size_t count = 0;
    for (char *end = words; count < MAX_REFERENCES; words = end) {
        const unsigned long found = strtoul(words, &end, 10);
        if (end == words)
            break;
        references[count++] = (unsigned)found;
    }
    return count;
}

/* getr SLOT REFERENCE...: all values in one call */
static void read_reals(struct session *session, void *instance, int slot, char *words)
{
    unsigned references[MAX_REFERENCES];
    const size_t count = read_references(words, references);
    double values[count + 1]; /* of this length, so that one too many is seen by the checks */
    memset(values, 0, sizeof values);
    print_reals(session, "getr", slot,
                fmu_get_reals(instance, references, count, values + 1), values + 1, count);
}

/* dir SLOT SEED KNOWN UNKNOWN...: directional derivatives along one variable */
static void read_derivatives(struct session *session, void *instance, int slot, char *words)
{
    unsigned references[MAX_REFERENCES];
    const double seed = strtod(words, &words);
    const size_t count = read_references(words, references);
    double values[count + 1];
    if (count < 2)
        exit(WRONG_SCRIPT);
    memset(values, 0, sizeof values);
    print_reals(session, "dir", slot,
                fmu_derivatives(instance, references + 1, count - 1, references[0], seed, values + 2),
                values + 2, count - 1);
}

static void assign(struct session *session, const char *verb, void *instance, int slot,
                   const char *words)
{
    unsigned reference = 0;
    double value = 0.0;
    if (sscanf(words, "%u %lf", &reference, &value) != 2)
        exit(WRONG_SCRIPT);
    answer(session, verb, slot, fmu_set(instance, verb[3], reference, value));
}

static void step(struct session *session, void *instance, int slot, const char *words)
{
    double time = 0.0, size = 0.0, last = 0.0;
    int status;
    if (sscanf(words, "%lf %lf", &time, &size) != 2)
        exit(WRONG_SCRIPT);
    status = fmu_step(instance, time, size, &last);
    print_reals(session, "step", slot, status, &last, 1);
}

/* Return whether the verb was one that changes nothing but the mode of the instance. */
static int change_mode(struct session *session, const char *verb, void *instance, int slot,
                       const char *words)
{
    int status;
    if (strcmp(verb, "setup") == 0)
        status = fmu_setup(instance, strtod(words, NULL));
    else if (strcmp(verb, "enter") == 0)
        status = fmu_enter(instance);
    else if (strcmp(verb, "exit") == 0)
        status = fmu_exit(instance);
    else if (strcmp(verb, "terminate") == 0)
        status = fmu_terminate(instance);
    else if (strcmp(verb, "reset") == 0)
        status = fmu_reset(instance);
    else
        return 0;
    answer(session, verb, slot, status);
    return 1;
}

/* Return whether the verb was one about a state; pack and unpack take it to another slot. */
static int use_state(struct session *session, const char *verb, struct slots *slots, int slot)
{
    void *instance = slots->instance[slot], **state = &slots->state[slot];
    int status;
    if (strcmp(verb, "save") == 0) {
        status = fmu_save(instance, state);
    } else if (strcmp(verb, "restore") == 0) {
        status = fmu_restore(instance, *state);
    } else if (strcmp(verb, "drop") == 0) {
        status = fmu_drop(instance, state);
    } else if (strcmp(verb, "pack") == 0) {
        status = fmu_packed_size(instance, *state, &slots->size);
        if (status == 0 && slots->size <= MAX_BYTES)
            status = fmu_pack(instance, *state, slots->bytes, slots->size);
    } else if (strcmp(verb, "unpack") == 0) {
        status = fmu_unpack(instance, slots->bytes, slots->size, state);
    } else {
        return 0;
    }
    answer(session, verb, slot, status);
    return 1;
}

static void call(struct session *session, struct slots *slots, const char *verb, int slot,
                 char *words)
{
    void *instance = slots->instance[slot];
    if (strcmp(verb, "new") == 0) {
        slots->instance[slot] = fmu_new(session, words);
        answer(session, verb, slot, slots->instance[slot] == NULL ? FATAL : 0);
    } else if (instance == NULL) {
        exit(NO_INSTANCE);
    } else if (strcmp(verb, "free") == 0) {
        fmu_free(instance);
        slots->instance[slot] = NULL;
        answer(session, verb, slot, 0);
    } else if (strncmp(verb, "set", 3) == 0 && strlen(verb) == 4) {
        assign(session, verb, instance, slot, words);
    } else if (strcmp(verb, "getr") == 0) {
        read_reals(session, instance, slot, words);
    } else if (strcmp(verb, "dir") == 0) {
        read_derivatives(session, instance, slot, words);
    } else if (strcmp(verb, "gets") == 0) {
        const char *text = "";
        const int status = fmu_get_text(instance, (unsigned)strtoul(words, NULL, 10), &text);
        fprintf(session->out, "gets %d %d %s\n", slot, status, text);
    } else if (strcmp(verb, "step") == 0) {
        step(session, instance, slot, words);
    } else if (!use_state(session, verb, slots, slot) &&
               !change_mode(session, verb, instance, slot, words)) {
        exit(WRONG_SCRIPT);
    }
}

int play(struct session *session, FILE *script)
{
    struct slots slots = {.bytes = calloc(1, MAX_BYTES)};
    unsigned long (*count)(void) = NULL;
    char line[LINE];
    *(void **)(&count) = symbol_if_any(NULL, "allocation_count");
    while (fgets(line, sizeof line, script) != NULL) {
        char verb[16];
        int slot = 0, read = 0;
        unsigned long before;
        line[strcspn(line, "\n")] = '\0';
        if (sscanf(line, "%15s %d %n", verb, &slot, &read) < 2 || slot < 0 || slot >= SLOTS)
            return WRONG_SCRIPT;
        before = count ? count() : 0;
        call(session, &slots, verb, slot, line + read);
        if (count != NULL && count() != before)
            fprintf(session->out, "allocated %d %lu %s\n", slot, count() - before, verb);
        fflush(session->out); /* what was said before a crash must not be lost */
    }
    free(slots.bytes);
    fprintf(session->out, "end\n");
    return 0;
}
