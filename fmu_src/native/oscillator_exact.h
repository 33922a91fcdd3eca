/* What the exact propagation of the coupled oscillator is made of: phasors and divided differences
 * of exponentials over its poles. The derivation is in fmu_src/oscillator_exact.py. */
#ifndef OSCILLATOR_EXACT_H
#define OSCILLATOR_EXACT_H

#include "oscillator_equations.h"
#include "phase.h"
#include "precise.h"

/* Below this phase angle between two poles the response is one divided difference. */
#define CONFLUENT 1e-2
/* A transient with this exponent is lost beside any number it could be added to. */
#define DECAYED (-100.0)

enum { MOST_COLUMNS = 4 };

/* Divided differences of F for one tone of unit amplitude. */
struct tone_kernel {
    struct complex node, gaps[2];  /* i u; i u - x1 and i u - x2 */
    struct pair confluent[3];      /* F[iu], F[iu, x1], F[iu, x1, x2] */
    struct pair periodic;          /* X(u) */
    struct pair split[2];          /* coefficients of E[x1, x2] and E[x2] beside the phasor */
    struct pair mirror[2];         /* those of their conjugates */
};

/* The eigenvalues above the real axis, their difference, 2 pi times the decay rates. */
struct roots {
    struct complex x1, x2, gap;
    double growth1, growth2;
    struct frequency frequency1, frequency2;
};

/* P(x) of a model: adj(P), the poles, and the polynomials U and V over them. */
struct pencil {
    struct polynomial adjugate[2][2], upper, lower;
    bool mirrored; /* whether there is a V */
    struct precise poles[2];
};

/* The numerators of the Laplace transform of an initial state. */
struct column {
    struct polynomial n[2];
};

/* The coefficients of E[x1, x2] and E[x2] for each initial state. */
struct free_part {
    struct pair first[MOST_COLUMNS], second[MOST_COLUMNS];
};

bool oscillator_pencil(const struct parameters *p, struct pencil *pencil, struct report *report);
bool rotating_pencil(const struct parameters *p, double centre, struct pencil *pencil,
                     struct report *report);
struct roots roots_of(const struct pencil *pencil);
bool tone_kernel_of(const struct pencil *pencil, const struct parameters *p, double u,
                    struct tone_kernel *kernel, struct report *report);
void free_part_of(const struct pencil *pencil, const struct column *columns, int count,
                  struct free_part *part);

/* E[a, b] from ea = exp(2 pi a t), eb and gap = a - b. */
struct complex first_difference(struct complex ea, struct complex eb, struct complex gap,
                                double t);
/* E[a, b, c] from the gaps a - b, a - c, b - c and the three exponentials. */
struct complex second_difference(const struct complex gaps[3], const struct complex values[3],
                                 double t);

#endif
