/* Complex numbers of 192 bits, and divided differences of polynomials and rational functions. */
#ifndef PRECISE_H
#define PRECISE_H

#include "complex_number.h"
#include "real.h"

enum { MOST_COEFFICIENTS = 5, MOST_NODES = 3 };

struct precise {
    struct real re, im;
};

/* Coefficients from the constant term up; a zero polynomial has size 1. */
struct polynomial {
    int32_t size;
    struct precise c[MOST_COEFFICIENTS];
};

/* t[i][j] = p[n_i, ..., n_j], the divided differences of a polynomial. */
struct differences {
    int32_t size;
    struct precise nodes[MOST_NODES];
    struct precise t[MOST_NODES][MOST_NODES];
};

struct precise precise_of(double re, double im);
struct precise precise_of_complex(struct complex z);
struct complex precise_complex(struct precise z);
struct precise precise_add(struct precise a, struct precise b);
struct precise precise_subtract(struct precise a, struct precise b);
struct precise precise_multiply(struct precise a, struct precise b);
struct precise precise_divide(struct precise a, struct precise b);
struct precise precise_negate(struct precise a);
struct precise precise_conjugate(struct precise a);
struct precise precise_sqrt(struct precise a);
bool precise_is_zero(struct precise a);
/* Solve by elimination with row pivots: rows of a square matrix, one after the other, are used up,
 * the solution comes in the place of the right side; false where the matrix is singular. */
bool precise_solve(struct precise *rows, struct precise *right, int size);
/* The imaginary part as the unevaluated sum of two doubles. */
void precise_split(struct precise z, double *high, double *low);

struct polynomial polynomial_constant(struct precise c);
struct polynomial polynomial_line(struct precise c0, struct precise c1);
struct polynomial polynomial_parabola(struct precise c0, struct precise c1, struct precise c2);
struct polynomial polynomial_negate(struct polynomial p);
struct polynomial polynomial_conjugate(struct polynomial p);
struct polynomial polynomial_add(struct polynomial a, struct polynomial b);
struct polynomial polynomial_multiply(struct polynomial a, struct polynomial b);

struct differences polynomial_differences(struct polynomial p, const struct precise *nodes,
                                          int size);
/* f[n_0], f[n_0, n_1], ... of f = numerator/denominator at the denominator's nodes. */
void rational_differences(struct polynomial numerator, const struct differences *denominator,
                          struct precise *result);
/* Turn a guess of e1, e2 into those of the factor x^2 - e1 x + e2 with the two roots of a real
 * quartic above the real axis; false where there is no such factor. */
bool upper_factor(const struct polynomial *quartic, struct precise *e1, struct precise *e2);

#endif
