/* A co-simulation host in C that knows nothing of Python: what its parts ask of each other.
 *
 * play.c replays a script of FMI calls through the functions fmu_*, which host_fmi2.c and host_fmi3.c
 * provide, each for its version of FMI. One of these two is linked. Statuses are those of FMI, which
 * has the same numbers for them in both versions.
 */
#ifndef HOST_H
#define HOST_H

#include <stddef.h>
#include <stdio.h>

/* Exit codes. */
enum { NOTHING_LOADED = 3, WRONG_SCRIPT = 4, NO_INSTANCE = 5 };

/* Of what the instances of one script belong to: the FMU's identity, where messages go. */
struct session {
    const char *token, *resources;
    FILE *out;
};

/* Load a library, or a symbol of it, or end the process with what the system says. */
void *load_library(const char *path, int everybody_sees_it);
void *symbol(void *library, const char *name);
/* NULL where a library, or for NULL the process, has no such symbol. */
void *symbol_if_any(void *library, const char *name);

/* Write a message to the logger as a line "log status category text". */
void write_log(struct session *session, int status, const char *category, const char *text);

void fmu_load(void *library);
void *fmu_new(struct session *session, const char *name);
void fmu_free(void *instance);
int fmu_setup(void *instance, double start);
int fmu_enter(void *instance);
int fmu_exit(void *instance);
int fmu_terminate(void *instance);
int fmu_reset(void *instance);
/* The last time that was reached, where the version of FMI tells it; else the step's end. */
int fmu_step(void *instance, double time, double size, double *last);
/* A value of a kind: 'r' a real number, 'i' a whole one, 'b' a truth value. */
int fmu_set(void *instance, char kind, unsigned reference, double value);
int fmu_get_reals(void *instance, const unsigned *references, size_t count, double *values);
int fmu_get_text(void *instance, unsigned reference, const char **text);
int fmu_derivatives(void *instance, const unsigned *unknowns, size_t count, unsigned known,
                    double seed, double *values);
int fmu_save(void *instance, void **state);
int fmu_restore(void *instance, void *state);
int fmu_drop(void *instance, void **state);
int fmu_packed_size(void *instance, void *state, size_t *size);
int fmu_pack(void *instance, void *state, char *bytes, size_t size);
int fmu_unpack(void *instance, const char *bytes, size_t size, void **state);

/* Replay the script; 0 or an exit code. */
int play(struct session *session, FILE *script);

#endif
