/* Replays several scripts of FMI calls (play.c) at once, each in a thread of its own.
 *
 *     threads FMU_LIBRARY RESOURCES TOKEN SCRIPT...
 *
 * The transcript of SCRIPT goes into a file beside it, SCRIPT.out.
 */
#include <pthread.h>

#include "host.h"

enum { MOST = 16 };

struct part {
    struct session session;
    FILE *script;
    int code;
    pthread_t thread;
};

static pthread_barrier_t together;

static void *run(void *argument)
{
    struct part *part = argument;
    pthread_barrier_wait(&together);
    part->code = play(&part->session, part->script);
    return NULL;
}

static void open_files(struct part *part, const char *path)
{
    char name[4096];
    snprintf(name, sizeof name, "%s.out", path);
    part->script = fopen(path, "r");
    part->session.out = fopen(name, "w");
}

int main(int count, char **arguments)
{
    static struct part parts[MOST];
    const int threads = count - 4;
    int code = 0;
    if (threads < 1 || threads > MOST)
        return WRONG_SCRIPT;
    fmu_load(load_library(arguments[1], 0));
    pthread_barrier_init(&together, NULL, (unsigned)threads);
    for (int k = 0; k < threads; ++k) {
        parts[k].session.resources = arguments[2];
        parts[k].session.token = arguments[3];
        open_files(&parts[k], arguments[4 + k]);
        if (parts[k].script == NULL || parts[k].session.out == NULL)
            return WRONG_SCRIPT;
    }
    for (int k = 0; k < threads; ++k)
        if (pthread_create(&parts[k].thread, NULL, run, &parts[k]) != 0)
            return WRONG_SCRIPT;
    for (int k = 0; k < threads; ++k) {
        pthread_join(parts[k].thread, NULL);
        code = parts[k].code > code ? parts[k].code : code;
        fclose(parts[k].script);
        fclose(parts[k].session.out);
    }
    return code;
}
