/* The life of one slave between an FMI and a model: values, phases, failure. It knows neither
 * memory nor the host, so that its state is the record itself, copied, but for the scratch at its
 * end: what a model makes again from the rest where it is missing or that of another state.
 *
 * "model.h" is written by build_fmu.py: the model's own header, and its variable table in numbers.
 */
#ifndef SLAVE_H
#define SLAVE_H

#include <stddef.h>
#include <stdint.h>

#include "model.h"
#include "sentence.h"

enum kind { REAL, INTEGER, BOOLEAN, STRING };
enum causality { PARAMETER, INPUT, OUTPUT };
enum phase { INSTANTIATED, INITIALISING, STEPPING, FAILED };

struct variable {
    const char *name;
    enum kind kind;
    enum causality causality;
    bool fixed;  /* a parameter that is settled at initialisation */
    bool moving; /* an output that changes with time */
    double start;
};

extern const struct variable variables[VARIABLE_COUNT];

struct slave {
    int32_t phase;
    bool changed, moving_stale, steady_stale;
    double time;
    double values[VARIABLE_COUNT]; /* whole numbers and truth values too */
    struct sentence message;       /* the one String, status_message */
    struct motion motion;          /* the model's own */
    struct scratch scratch;        /* the model's own, not stored */
};

#define STATE_SIZE offsetof(struct slave, scratch)

/* What a model provides; each may refuse. */
bool model_begin(struct slave *slave, double t, struct report *report);
bool model_change(struct slave *slave, double t, struct report *report);
bool model_step(struct slave *slave, double t, double end, struct report *report);
bool model_moving(struct slave *slave, double *outputs, struct report *report);
bool model_steady(struct slave *slave, double *outputs, struct report *report);

/* What the outputs change by if the variables do by seed (as many as there are variables): since the
 * present stretch of the run began, with a change of parameters or input, or the start. NAN where no
 * closed form is known. */
bool model_derivative(struct slave *slave, const double *seed, double *moving, double *steady,
                      struct report *report);

/* Calls of FMI, which are recorded as failed by the slave itself. */
void slave_start(struct slave *slave);
void slave_enter_initialisation(struct slave *slave);
void slave_exit_initialisation(struct slave *slave, struct report *report);
bool slave_step(struct slave *slave, double t, double step, struct report *report);
void slave_settle(struct slave *slave, struct report *report);
void slave_get(struct slave *slave, enum kind kind, const unsigned *references, size_t count,
               double *values, struct report *report);
/* Whether there is such a variable of a kind. */
bool slave_knows(enum kind kind, unsigned reference);
/* Whether a String has this text, the only one that an output may be "set" to. */
bool slave_says(const struct slave *slave, unsigned reference, const char *text);
void slave_set(struct slave *slave, enum kind kind, const unsigned *references, size_t count,
               const double *values, struct report *report);
/* Refuses without failing. */
bool slave_derivative(struct slave *slave, const unsigned *unknowns, size_t unknown_count,
                      const unsigned *knowns, size_t known_count, const double *seed,
                      double *derivatives, struct report *report);
void slave_fail(struct slave *slave, struct report *report);

#endif
