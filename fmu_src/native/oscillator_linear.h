/* The solvers "exact" and "envelope": the kernel of a set of parameters applied to a run. */
#ifndef OSCILLATOR_LINEAR_H
#define OSCILLATOR_LINEAR_H

#include "oscillator_exact.h"

/* Displacements and velocities over 2 pi of both modes (exact); analytic signals (envelope). */
struct state {
    struct complex z[4];
};

/* An active tone: A exp(i phase), cycles added by retuning, phasors times amplitude; and, with a
 * transient, its kernel, its amplitude at the anchor, and how long it stays close to a pole. */
struct tone {
    struct complex amplitude, at_anchor;
    double u, offset, until;
    struct frequency frequency;
    struct pair periodic;
    struct tone_kernel kernel;
};

struct linear_solver {
    struct parameters p;
    bool envelope, in_motion, has_kernel, has_free; /* in_motion: not on the periodic orbit */
    int32_t tones;
    double offsets[2], centre, anchor, b, early_until, at_rest[2];
    struct tone tone[2];
    struct pencil pencil;
    struct roots roots;
    struct free_part free;
    struct state state;
    struct pair own[2], sum[2]; /* coefficients of E[x1, x2] and E[x2]: of the state, of all */
};

bool linear_prepare(struct linear_solver *solver, const struct parameters *p, bool envelope,
                    const double offsets[2], struct report *report);
/* Begin at t from a state (NULL: on the periodic orbit) with input b. */
bool linear_start(struct linear_solver *solver, double t, const struct state *state, double b,
                  struct report *report);
bool linear_response(const struct linear_solver *solver, double u, struct pair *x,
                     struct report *report);
bool linear_grows(const struct linear_solver *solver);
void linear_displacement(const struct linear_solver *solver, double t, double q[2]);
struct state linear_state(const struct linear_solver *solver, double t);

#endif
