/* One driven oscillator, m x'' + c x' + k x = F, with the force held over a step: exact steps.
   Part of the test FMUs; what they do wrong on purpose is chosen by the parameter `misbehave` and, for
   the reset, by the macro RESET when compiled. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifndef _WIN32
#include <arpa/inet.h>
#include <dlfcn.h>
#include <signal.h>
#include <sys/socket.h>
#include <unistd.h>
#endif

enum { MASS, DAMPING, STIFFNESS, FORCE, DISPLACEMENT, EIGENFREQUENCY, LINE_WIDTH, N_REALS };
enum { MISBEHAVE = 100, STEPS = 101, INVERTED = 200, LABEL = 300 };
enum { GOOD, HANGS, CRASHES, NAN_OUTPUT, ENDS_EARLY, FAILS_AT_START, FAILS_IN_STEP, IS_PENDING,
       WARNS, HANGS_AT_START, PRINTS_AND_ABORTS, IS_KILLED, IS_KILLED_ONCE, FORKS,
       PRINTS_MUCH_AND_ABORTS, WRITES_FILE, FILLS_MEMORY, FILLS_DISK, OPENS_MANY, OPENS_SOCKET,
       ESCAPES, RUNS_PYTHON };
enum { RESET_WORKS, RESET_DOES_NOTHING, RESET_KEEPS_DERIVED, RESET_CRASHES, RESET_FAILS, RESET_HANGS,
       RESET_FREEZES_OUTPUT, RESET_KEEPS_PARAMETERS };
#ifndef NOISE /* of the output, relative, another one at every step of another length or number */
#define NOISE 0.0
#endif
#ifndef GROWTH /* of that noise, per second */
#define GROWTH 0.0
#endif
#ifndef OWN_STEP /* of its own solver, s, whatever the communication step; 0: none */
#define OWN_STEP 0.0
#endif
#ifndef RESET
#define RESET RESET_WORKS
#endif

typedef struct {
    double reals[N_REALS];
    int misbehave, steps, inverted, derived, frozen;
    double x, v, time, own_time;
    char label[400];
    void *logger, *environment;
} Model;

static const double PI = 3.14159265358979323846;

static void model_start_values(Model *m) {
    const double reals[N_REALS] = {1e-3, 2e-2, 4e3, 0, 0, 0, 0};
    memcpy(m->reals, reals, sizeof reals);
    m->misbehave = m->inverted = 0;
    strcpy(m->label, "oscillator");
}

static void model_states(Model *m) {
    m->x = m->v = m->time = m->own_time = 0;
    m->steps = 0;
}

static void model_output(Model *m) {
    if (m->frozen) return;
    /* so that a test can tell from outside that a flag and a text have arrived */
    m->reals[DISPLACEMENT] = m->inverted || !strcmp(m->label, "upside down") ? -m->x : m->x;
    if (NOISE > 0.0)
        m->reals[DISPLACEMENT] *=
            1.0 + NOISE * (1.0 + GROWTH * m->time) * sin(1e9 * m->time * (1.0 + m->x) + 1e3 * m->steps);
    if (m->misbehave == NAN_OUTPUT && m->time > 0) m->reals[DISPLACEMENT] = NAN;
}

static void model_begin(Model *m, double start) { m->time = start; }

static void model_initialise(Model *m) {
    m->own_time = m->time;
    if (!m->derived) {
        m->reals[EIGENFREQUENCY] = sqrt(m->reals[STIFFNESS] / m->reals[MASS]) / (2 * PI);
        m->reals[LINE_WIDTH] = m->reals[DAMPING] / m->reals[MASS] / (2 * PI);
        m->derived = 1;
    }
    model_output(m);
}

/* x(t+h) by the closed solution; s is the square of the damped frequency, of either sign */
static void model_move(Model *m, double h) {
    double w2 = 2 * PI * m->reals[EIGENFREQUENCY], g = PI * m->reals[LINE_WIDTH], s, c, d;
    double rest = m->reals[FORCE] / m->reals[STIFFNESS], x, v;
    w2 *= w2;
    s = w2 - g * g;
    if (s > 0) {
        double w = sqrt(s);
        c = cos(w * h), d = sin(w * h) / w;
    } else if (s < 0) {
        double w = sqrt(-s);
        c = cosh(w * h), d = sinh(w * h) / w;
    } else {
        c = 1, d = h;
    }
    x = m->x - rest, v = m->v;
    m->x = rest + exp(-g * h) * (x * (c + g * d) + v * d);
    m->v = exp(-g * h) * (v * (c - g * d) - x * w2 * d);
}

/* a step of the host; with OWN_STEP as many of these as fit, counted as they add up */
static void model_step(Model *m, double h) {
    m->time += h;
    if (OWN_STEP > 0.0)
        for (; m->own_time + OWN_STEP <= m->time; m->own_time += OWN_STEP) model_move(m, OWN_STEP);
    else
        model_move(m, h);
    m->steps += 1;
    model_output(m);
}

static void model_hang(void) {
    for (volatile int on = 1; on;) {}
}

static void model_crash(void) {
    *(volatile int *)8 = 1;
}

#ifndef _WIN32
/* a child that never ends and keeps open whatever is open here; its number goes to a file */
static void model_fork(const char *path) {
    FILE *file;
    pid_t child;
    if (!access(path, F_OK)) return;
    child = fork();
    if (!child)
        for (;;) pause();
    file = fopen(path, "w"), fprintf(file, "%d\n", (int)child), fclose(file);
}

static const char file_block[1 << 16];

/* to the port of this machine that the label names; what came of it goes to a file */
static void model_connect(const char *port) {
    struct sockaddr_in to = {.sin_family = AF_INET, .sin_port = htons((unsigned short)atoi(port))};
    int handle = socket(AF_INET, SOCK_STREAM, 0);
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (handle < 0 || connect(handle, (struct sockaddr *)&to, sizeof to))
        perror("no connection"), abort();
    close(handle);
}

/* a file of Python, in the interpreter that the worker is */
static void model_python(const char *path) {
    int (*enter)(void) = (int (*)(void))dlsym(RTLD_DEFAULT, "PyGILState_Ensure");
    void (*leave)(int) = (void (*)(int))dlsym(RTLD_DEFAULT, "PyGILState_Release");
    int (*run)(const char *, void *) = (int (*)(const char *, void *))dlsym(RTLD_DEFAULT, "PyRun_SimpleStringFlags");
    char line[600];
    int state;
    if (!enter || !leave || !run) fprintf(stderr, "no Python here\n"), abort();
    snprintf(line, sizeof line, "exec(compile(open(r'%s').read(), 'attempts', 'exec'), {})", path);
    state = enter();
    if (run(line, NULL)) abort();
    leave(state);
}

/* what befalls the process as a whole; `label` is a path where one is wanted */
static void model_befall(const Model *m) {
    FILE *file;
#ifdef HANGS_WHERE_VARIED /* and tells so in a file of that name */
    if (m->reals[STIFFNESS] != 4e3)
        file = fopen(HANGS_WHERE_VARIED, "a"), fputs("hangs\n", file), fclose(file), model_hang();
#endif
#ifdef FORKS_ONCE
    model_fork(FORKS_ONCE);
#endif
    switch (m->misbehave) {
    case IS_KILLED: raise(SIGKILL); break;
    case IS_KILLED_ONCE:
        if (access(m->label, F_OK)) fclose(fopen(m->label, "w")), raise(SIGKILL);
        break;
    case FORKS: model_fork(m->label); break;
    case PRINTS_MUCH_AND_ABORTS:
        for (int i = 0; i < 300000; i++) printf("line %d of very many\n", i);
        fflush(stdout);
        fprintf(stderr, "the very last line\n");
        abort();
    case FILLS_MEMORY:
        for (size_t i = 1; i; i++) memset(malloc(1 << 24), (int)i, 1 << 24);
        break;
    case FILLS_DISK: /* "many": in files of 1 MB, else in one */
        for (int i = 0; i < 100000; i++) {
            char name[32];
            snprintf(name, sizeof name, "much%d.bin", strcmp(m->label, "many") ? 0 : i / 16);
            file = fopen(name, "a");
            if (!file || fwrite(file_block, sizeof file_block, 1, file) != 1) break;
            fclose(file);
        }
        model_hang();
        break;
    case OPENS_MANY:
        for (int i = 0; i < 10000; i++)
            if (!fopen(m->label, "r")) fprintf(stderr, "no more files\n"), abort();
        break;
    case OPENS_SOCKET: model_connect(m->label); break;
    case ESCAPES:
        if (!(file = fopen(m->label, "w"))) perror("cannot write there"), abort();
        fclose(file);
        break;
    case RUNS_PYTHON: model_python(m->label); break;
    case WRITES_FILE: file = fopen("trace.txt", "w"), fputs("a trace\n", file), fclose(file); break;
    }
}
#else
static void model_befall(const Model *m) {}
#endif

/* OK (0) or error (3), as FMI has it */
static int model_reset(Model *m) {
    switch (RESET) {
    case RESET_DOES_NOTHING: return 0;
    case RESET_KEEPS_DERIVED: {
        double eigenfrequency = m->reals[EIGENFREQUENCY], line_width = m->reals[LINE_WIDTH];
        model_start_values(m), model_states(m);
        m->reals[EIGENFREQUENCY] = eigenfrequency, m->reals[LINE_WIDTH] = line_width;
        return 0;
    }
    case RESET_CRASHES: model_crash(); return 0;
    case RESET_FAILS: return 3;
    case RESET_HANGS: model_hang(); return 0;
    case RESET_FREEZES_OUTPUT: model_start_values(m), model_states(m), m->frozen = 1; return 0;
    case RESET_KEEPS_PARAMETERS: model_states(m), m->derived = 0; return 0;
    default: model_start_values(m), model_states(m), m->derived = 0; return 0;
    }
}

static double model_get(const Model *m, unsigned which) { return m->reals[which]; }

#define LISTENS(M, LOGGER, ENVIRONMENT) (M)->logger = (void *)(LOGGER), (M)->environment = (ENVIRONMENT)

/* with ONLY_ONE_INSTANCE a second one in a process fails */
static Model *model_new(void) {
    Model *m;
#ifdef ONLY_ONE_INSTANCE
    static int instances;
    if (instances++) return NULL;
#endif
    m = calloc(1, sizeof *m);
    model_start_values(m);
    return m;
}

static void model_free(Model *m) {
#ifdef CRASHES_WHEN_FREED
    model_crash();
#endif
#ifdef HANGS_WHEN_FREED /* and tells so in a file of that name */
    fclose(fopen(HANGS_WHEN_FREED, "w")), model_hang();
#endif
    free(m);
}
