/* The motion of the FMU CoupledOscillator: one of three solvers. */
#ifndef COUPLED_OSCILLATOR_H
#define COUPLED_OSCILLATOR_H

#include "oscillator_linear.h"
#include "oscillator_rk4.h"
#include "oscillator_single.h"
#include "tangent.h"

enum solver { EXACT, ENVELOPE, RK4 };
enum method { LINEAR, SINGLE, RUNGE_KUTTA };

/* All that there is, is stored, but for the room in which derivatives are calculated. */
struct scratch {
    struct propagator room;
};

struct motion {
    int32_t method;
    double since; /* where changed frequencies begin to turn the phase: see tangent.h */
    union {
        struct linear_solver linear;
        struct single_solver single;
        struct rk4_solver rk4;
    };
};

#endif
