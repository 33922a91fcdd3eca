/* The plane of the two oscillating modes in the linear system's state space, and the solvent S of
 * S^2 + D~ S + C~ = 0 that moves it. See fmu_src/duffing_plane.py. */
#ifndef DUFFING_PLANE_H
#define DUFFING_PLANE_H

#include "oscillator_exact.h"

/* [[m11, m12], [m21, m22]] */
struct matrix {
    struct complex m11, m12, m21, m22;
};

struct plane {
    struct matrix solvent;   /* S in 1/s */
    double gain[4];          /* (2 Im S)^-1 in s, row by row */
    struct complex rates[2]; /* of the coordinates w of y = V w */
    struct complex cross[2]; /* what is left beside them where eigenvectors do not serve */
    struct complex mix[2];   /* V12 and V21 */
};

bool plane_of(const struct parameters *p, double centre, struct plane *plane,
              struct report *report);
struct matrix matrix_inverse(struct matrix m);
struct matrix matrix_conjugate(struct matrix m);
struct pair matrix_times(const struct matrix *m, struct pair x);
/* gain times a pair, times i */
struct pair plane_turned_gain(const struct plane *plane, struct pair x);
struct pair plane_amplitudes(const struct plane *plane, struct pair w);
struct pair plane_coordinates(const struct plane *plane, struct pair y);

#endif
