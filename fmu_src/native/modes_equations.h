/* N coupled modes with a parametric pump: parameters, what they forbid, and the matrices over
 * (2 pi)^2. The equations are in fmu_src/modes_equations.py. */
#ifndef MODES_EQUATIONS_H
#define MODES_EQUATIONS_H

#include "modes_matrices.h"
#include "sentence.h"

/* Pairs i < j go row by row; a record needs a place for at least one. */
enum { PAIRS = MODES * (MODES - 1) / 2, PAIR_PLACES = PAIRS ? PAIRS : 1 };

/* What moves the modes, without the drive. */
struct modes {
    double f[MODES], d[MODES], coupling[PAIR_PLACES];
    double depth_f[MODES], depth_coupling[PAIR_PLACES];
    double pump_hz;
};

/* Under a pump, tolerance is what accuracy is asked for, and readout of which sum. */
struct parameters {
    struct modes modes;
    double g[MODES];
    double u[2], size[2], phase[2], pump_phase;
    double readout[MODES], tolerance;
};

/* C, C_p and D in 192 bits and as doubles, and what bounds them: see Matrices in the Python model. */
struct matrices {
    struct real stiffness[MODES][MODES], pump[MODES][MODES], damping[MODES];
    double stiffness_values[MODES][MODES], damping_values[MODES];
    double pump_values[MODES][MODES], eta[MODES], shapes[MODES][MODES];
    double lowest, highest, narrowest, widest, pump_norm, relative_pump;
};

bool pumped(const struct modes *modes);
double least_of(const double *x);
double largest_of(const double *x);
/* Refuse what has no meaning, and warn of growth. */
bool check_parameters(const struct parameters *p, bool periodic_start, struct report *report);
bool matrices_of(const struct modes *modes, struct matrices *m, struct report *report);

#endif
