/* The solver "rk4" of N modes: the equations as they stand, pump included, by the classical method
 * with a fixed substep. */
#ifndef MODES_RK4_H
#define MODES_RK4_H

#include "modes_equations.h"
#include "phase.h"

/* Displacements and velocities of all modes at the communication point reached. */
struct rk4_state {
    double t, q[MODES], v[MODES];
};

/* The equations in doubles, made of the parameters. */
struct rk4_equations {
    double stiffness[MODES][MODES], pump[MODES][MODES], damping[MODES], g[MODES];
    double size[2], offset[2], pump_offset, pump_cycles, b, substep, fastest_hz;
    bool pumped;
    int32_t tones;
    struct frequency tone[2], pump_frequency;
};

/* substep 0: a fortieth of the shortest period; fastest_hz is the system's own. */
struct rk4_equations rk4_equations_of(const struct parameters *p, const struct matrices *m,
                                      double substep, double fastest_hz, const double offsets[3]);
bool rk4_advance(const struct rk4_equations *e, struct rk4_state *state, double t,
                 struct report *report);

#endif
