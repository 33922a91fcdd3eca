/* The motion of the FMU CoupledOscillator: one of three solvers. */
#ifndef COUPLED_OSCILLATOR_H
#define COUPLED_OSCILLATOR_H

#include "oscillator_linear.h"
#include "oscillator_rk4.h"
#include "oscillator_single.h"

enum solver { EXACT, ENVELOPE, RK4 };
enum method { LINEAR, SINGLE, RUNGE_KUTTA };

/* All that there is, is stored. */
struct scratch {
    bool made;
};

struct motion {
    int32_t method;
    union {
        struct linear_solver linear;
        struct single_solver single;
        struct rk4_solver rk4;
    };
};

#endif
