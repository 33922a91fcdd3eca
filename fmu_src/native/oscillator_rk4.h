/* The solver "rk4": the classical Runge-Kutta method with a fixed substep, for comparison. */
#ifndef OSCILLATOR_RK4_H
#define OSCILLATOR_RK4_H

#include "oscillator_linear.h"

/* Displacements and velocities of both modes: q1, q2, v1, v2. */
struct point {
    double y[4];
};

struct rk4_tone {
    double amplitude, offset;
    struct frequency frequency;
};

struct rk4_solver {
    struct parameters p;
    int32_t tones;
    double offsets[2], requested, substep, t, b;
    double alpha1, alpha2, kappa; /* of cubic forces, 0 in the linear system */
    struct damping damping;       /* in 1/s */
    double stiffness[2];
    struct rk4_tone tone[2];
    struct point at;
};

void rk4_prepare(struct rk4_solver *solver, const struct parameters *p, double substep,
                 const double offsets[2]);
bool rk4_start(struct rk4_solver *solver, double t, const struct state *state, double b,
               struct report *report);
/* Go on from another solver's state. */
void rk4_take_over(struct rk4_solver *solver, const struct rk4_solver *other);
bool rk4_advance(struct rk4_solver *solver, double t, struct report *report);

#endif
