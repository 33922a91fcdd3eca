/* The motion of the FMU DuffingOscillator: one of two solvers. */
#ifndef DUFFING_OSCILLATOR_H
#define DUFFING_OSCILLATOR_H

#include "duffing_envelope.h"
#include "oscillator_rk4.h"

enum solver { ENVELOPE = 1, RK4 }; /* the numbers that they have in CoupledOscillator */
enum branch { LOWER, UPPER };

/* All that there is, is stored; a record needs a member. */
struct scratch {
    bool unused;
};

struct motion {
    int32_t solver;
    union {
        struct envelope_solver envelope;
        struct rk4_solver rk4;
    };
};

#endif
