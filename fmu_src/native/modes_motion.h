/* Transients of N modes: the generator of y = (x, x'/(2 pi F)), or of the envelope's y = (Re z,
 * Im z), and Taylor series under a pump. See fmu_src/modes_motion.py. */
#ifndef MODES_MOTION_H
#define MODES_MOTION_H

#include "modes_steady.h"
#include "propagator.h"

/* Periods of the fastest mode in a pump period that are integrated; beyond, nobody would wait. The
 * substeps of such a period are pi times as many. */
enum { MOST_PERIODS = 500, MOST_SUBSTEPS = 1600, MOST_POWERS = 64 };

/* G and G_p in Hz, row by row, and the scale F in Hz (0 for the envelope). */
struct generator {
    struct real still[STATES * STATES], pumped[STATES * STATES];
    int32_t scale_power; /* F = 2^scale_power, so that changing it rounds nothing */
    bool scaled;
};

/* The rows times 2 pi in doubles, without their zeros. */
struct sparse {
    int32_t count[STATES], column[STATES][STATES];
    double value[STATES][STATES];
};

struct pumped_propagator {
    struct sparse still, pumped;
    double pump_hz, substep;
};

/* Columns of a matrix. */
struct columns {
    double x[STATES][STATES];
};

/* The propagators from the beginning of a pump period to its substeps, and their powers. */
struct period_table {
    int32_t count, powers;
    double part;
    struct columns step[MOST_SUBSTEPS + 1], power[MOST_POWERS];
};

bool generator_of(const struct matrices *m, const struct frame *frame, struct generator *made,
                  struct report *report);
void pumped_propagator_make(struct pumped_propagator *flow, const struct generator *made,
                            double pump_hz, double fastest_hz);
/* Put y after a span that begins at the pump's phase psi in the place of y. */
void pumped_move(const struct pumped_propagator *flow, double *y, double span, double psi);
void period_table_make(struct period_table *table, const struct pumped_propagator *flow);
/* y, at a phase of 0, whole periods and a fraction of one later. */
void period_table_move(struct period_table *table, const struct pumped_propagator *flow, double *y,
                       uint64_t periods, double fraction);
/* Whether a bound that costs nothing excludes growth under the pump. */
bool pump_conserves(const struct matrices *m, double pump_hz);
/* A number below 1 if the largest Floquet multiplier is, else that multiplier. */
double growth_of(const struct period_table *table);

#endif
