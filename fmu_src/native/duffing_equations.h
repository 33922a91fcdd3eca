/* Two hybridised modes with cubic terms: closed forms. See fmu_src/duffing_equations.py. */
#ifndef DUFFING_EQUATIONS_H
#define DUFFING_EQUATIONS_H

#include "sentence.h"

enum { UNKNOWNS = 4 };

/* The cubic coefficients, in 1/(m^2 s^2). */
struct cubic {
    double alpha1, alpha2, kappa;
};

struct squares {
    double low, high;
};

/* A function of several unknowns, which may refuse. */
struct root_problem {
    bool (*function)(const void *context, const double x[UNKNOWNS], double value[UNKNOWNS],
                     struct report *report);
    const void *context;
    double scales[UNKNOWNS];
};

bool any_cubic(const struct cubic *cubic);
bool check_cubic(const struct cubic *cubic, struct report *report);
/* The relative frequency shift by the cubic terms, the larger one of both modes. */
double cubic_shift(const struct cubic *cubic, const double squares[2], double centre);
/* The smallest and the largest |a|^2 of one driven Duffing mode in its steady state. */
struct squares steady_squares(double detuning, double damping, double alpha, double drive);
/* Turn x into a zero near it by Newton's method; *found is false where it does not settle on a
 * stable one. Returns false where the function refuses. */
bool find_root(const struct root_problem *problem, double x[UNKNOWNS], bool *found,
               struct report *report);

#endif
