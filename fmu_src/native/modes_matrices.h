/* Small dense matrices: what N modes need of linear algebra. */
#ifndef MODES_MATRICES_H
#define MODES_MATRICES_H

#include "precise.h"
#include "size.h"

/* SIZE, the number at the end of the model's name, is written by build_fmu.py. */
enum { MODES = SIZE, STATES = 2 * MODES };

struct vector {
    struct complex x[MODES];
};

struct matrix {
    struct complex x[MODES][MODES];
};

struct precise_vector {
    struct precise x[MODES];
};

struct precise_matrix {
    struct precise x[MODES][MODES];
};

/* By Gauss and Jordan with row pivots; false where the matrix is singular. */
bool matrix_inverse(const struct matrix *a, struct matrix *inverse);
struct matrix matrix_product(const struct matrix *a, const struct matrix *b);
struct vector matrix_applied(const struct matrix *a, const struct vector *x);
struct vector matrix_transposed_applied(const struct matrix *a, const struct vector *x);
/* The Frobenius norm, which bounds the 2-norm. */
double matrix_norm(const struct matrix *a);
double vector_norm(const struct vector *x);
double vector_largest(const struct vector *x);
/* The root of the sum of squares of some numbers, none of which leaves the range of a double. */
double norm_of(const double *x, int count);
struct vector precise_vector_rounded(const struct precise_vector *x);
/* Eigenvalues, rising, of a symmetric matrix and its vectors as columns, by Jacobi's rotations. */
void eigensystem(double matrix[MODES][MODES], double values[MODES],
                 double vectors[MODES][MODES]);

#endif
