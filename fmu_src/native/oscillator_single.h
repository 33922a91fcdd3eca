/* The exact solver with one mode only: the other answers at once, like a spring, or not at all. See
 * fmu_src/oscillator_single.py. */
#ifndef OSCILLATOR_SINGLE_H
#define OSCILLATOR_SINGLE_H

#include "oscillator_linear.h"

enum other_mode { FULL, QUASI_STATIC, LEFT_OUT };

struct single_tone {
    double u, offset;
    struct frequency frequency;
    struct pair periodic;
};

struct single_solver {
    struct parameters p;
    int32_t other, near, tones;
    bool in_motion;
    double offsets[2], anchor, b, at_rest[2];
    double decay, omega, turning; /* of the near mode, in 1/s */
    double cosine, sine;          /* the transient's coefficients */
    struct frequency cycles;
    struct single_tone tone[2];
};

bool single_prepare(struct single_solver *solver, const struct parameters *p, int other,
                    const double offsets[2], struct report *report);
bool single_start(struct single_solver *solver, double t, const struct state *state, double b,
                  struct report *report);
bool single_response(const struct single_solver *solver, double u, struct pair *x,
                     struct report *report);
bool single_grows(const struct single_solver *solver);
void single_displacement(const struct single_solver *solver, double t, double q[2]);
struct state single_state(const struct single_solver *solver, double t);

#endif
