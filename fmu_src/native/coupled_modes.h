/* The motion of the FMUs CoupledModes1 to CoupledModes9, by one of three solvers. */
#ifndef COUPLED_MODES_H
#define COUPLED_MODES_H

#include "modes_linear.h"
#include "modes_rk4.h"

enum solver { EXACT, ENVELOPE, RK4 };

struct motion {
    int32_t solver;
    double substep; /* of rk4, as asked for */
    struct run run; /* with rk4: parameters, offsets and input alone */
    struct rk4_state at;
};

#endif
