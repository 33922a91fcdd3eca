/* The operations come in the order of fmu_src/modes_matrices.py, so that both round alike. */
#include "modes_matrices.h"

#include <string.h>

enum { SWEEPS = 60 };

double norm_of(const double *x, int count)
{
    double largest = 0.0, total = 0.0;
    for (int i = 0; i < count; ++i)
        largest = fmax(largest, fabs(x[i]));
    if (largest == 0.0 || !isfinite(largest))
        return largest;
    for (int i = 0; i < count; ++i)
        total += (x[i] / largest) * (x[i] / largest);
    return largest * sqrt(total);
}

double matrix_norm(const struct matrix *a)
{
    double sizes[MODES * MODES];
    for (int i = 0; i < MODES; ++i)
        for (int j = 0; j < MODES; ++j)
            sizes[MODES * i + j] = c_abs(a->x[i][j]);
    return norm_of(sizes, MODES * MODES);
}

double vector_norm(const struct vector *x)
{
    double sizes[MODES];
    for (int i = 0; i < MODES; ++i)
        sizes[i] = c_abs(x->x[i]);
    return norm_of(sizes, MODES);
}

double vector_largest(const struct vector *x)
{
    double largest = 0.0;
    for (int i = 0; i < MODES; ++i)
        largest = fmax(largest, c_abs(x->x[i]));
    return largest;
}

bool matrix_inverse(const struct matrix *a, struct matrix *inverse)
{
    struct complex rows[MODES][2 * MODES];
    memset(rows, 0, sizeof rows);
    for (int i = 0; i < MODES; ++i) {
        memcpy(rows[i], a->x[i], sizeof a->x[i]);
        rows[i][MODES + i].re = 1.0;
    }
    for (int i = 0; i < MODES; ++i) {
        int best = i;
        struct complex kept[2 * MODES], pivot;
        for (int k = i + 1; k < MODES; ++k)
            if (c_abs(rows[k][i]) > c_abs(rows[best][i]))
                best = k;
        pivot = rows[best][i];
        if (c_is_zero(pivot))
            return false;
        memcpy(kept, rows[best], sizeof kept);
        memcpy(rows[best], rows[i], sizeof kept);
        for (int j = 0; j < 2 * MODES; ++j)
            rows[i][j] = c_divide(kept[j], pivot);
        for (int k = 0; k < MODES; ++k) {
            const struct complex factor = rows[k][i];
            if (k == i || c_is_zero(factor))
                continue;
            for (int j = 0; j < 2 * MODES; ++j)
                rows[k][j] = c_subtract(rows[k][j], c_multiply(factor, rows[i][j]));
        }
    }
    for (int i = 0; i < MODES; ++i)
        memcpy(inverse->x[i], rows[i] + MODES, sizeof inverse->x[i]);
    return true;
}

struct matrix matrix_product(const struct matrix *a, const struct matrix *b)
{
    struct matrix c;
    memset(&c, 0, sizeof c);
    for (int i = 0; i < MODES; ++i)
        for (int j = 0; j < MODES; ++j)
            for (int k = 0; k < MODES; ++k)
                c.x[i][j] = c_add(c.x[i][j], c_multiply(a->x[i][k], b->x[k][j]));
    return c;
}

struct vector matrix_applied(const struct matrix *a, const struct vector *x)
{
    struct vector y;
    memset(&y, 0, sizeof y);
    for (int i = 0; i < MODES; ++i)
        for (int j = 0; j < MODES; ++j)
            y.x[i] = c_add(y.x[i], c_multiply(a->x[i][j], x->x[j]));
    return y;
}

struct vector matrix_transposed_applied(const struct matrix *a, const struct vector *x)
{
    struct vector y;
    memset(&y, 0, sizeof y);
    for (int i = 0; i < MODES; ++i)
        for (int j = 0; j < MODES; ++j)
            y.x[i] = c_add(y.x[i], c_multiply(a->x[j][i], x->x[j]));
    return y;
}

struct vector precise_vector_rounded(const struct precise_vector *x)
{
    struct vector y;
    for (int i = 0; i < MODES; ++i)
        y.x[i] = precise_complex(x->x[i]);
    return y;
}

/* --- eigenvalues ------------------------------------------------------------------------------ */

/* Whether an entry beside the diagonal is more than rounding. */
static bool counts(double a[MODES][MODES], int i, int j)
{
    return fabs(a[i][j]) > 1e-17 * sqrt(fabs(a[i][i])) * sqrt(fabs(a[j][j]));
}

/* Turn the entry (i, j) to zero. */
static void rotate(double a[MODES][MODES], double v[MODES][MODES], int i, int j)
{
    const double slope = (a[j][j] - a[i][i]) / (2.0 * a[i][j]);
    const double t = copysign(1.0, slope) / (fabs(slope) + hypot(1.0, slope));
    const double c = 1.0 / hypot(1.0, t), s = t * c, turned = t * a[i][j];
    a[i][i] -= turned;
    a[j][j] += turned;
    a[i][j] = a[j][i] = 0.0;
    for (int k = 0; k < MODES; ++k) {
        const double x = a[k][i], y = a[k][j], p = v[k][i], q = v[k][j];
        if (k != i && k != j) {
            a[k][i] = a[i][k] = c * x - s * y;
            a[k][j] = a[j][k] = s * x + c * y;
        }
        v[k][i] = c * p - s * q;
        v[k][j] = s * p + c * q;
    }
}

/* One turn through all entries that count before it; false where there are none. */
static bool swept(double a[MODES][MODES], double v[MODES][MODES])
{
    bool counted[MODES][MODES], any = false;
    for (int i = 0; i < MODES; ++i)
        for (int j = i + 1; j < MODES; ++j) {
            counted[i][j] = counts(a, i, j);
            any = any || counted[i][j];
        }
    for (int i = 0; i < MODES; ++i)
        for (int j = i + 1; j < MODES; ++j)
            if (counted[i][j] && a[i][j] != 0.0)
                rotate(a, v, i, j);
    return any;
}

void eigensystem(double matrix[MODES][MODES], double values[MODES],
                 double vectors[MODES][MODES])
{
    double a[MODES][MODES], v[MODES][MODES];
    int order[MODES];
    memcpy(a, matrix, sizeof a);
    for (int i = 0; i < MODES; ++i) {
        for (int j = 0; j < MODES; ++j)
            v[i][j] = i == j ? 1.0 : 0.0;
        order[i] = i;
    }
    for (int k = 0; k < SWEEPS && swept(a, v); ++k)
        continue;
    for (int i = 1; i < MODES; ++i) /* stable, as there are few */
        for (int k = i; k > 0 && a[order[k]][order[k]] < a[order[k - 1]][order[k - 1]]; --k) {
            const int kept = order[k];
            order[k] = order[k - 1];
            order[k - 1] = kept;
        }
    for (int i = 0; i < MODES; ++i) {
        int largest = 0;
        for (int k = 1; k < MODES; ++k)
            if (fabs(v[k][order[i]]) > fabs(v[largest][order[i]]))
                largest = k;
        values[i] = a[order[i]][order[i]];
        for (int k = 0; k < MODES; ++k)
            vectors[k][i] = copysign(1.0, v[largest][order[i]]) * v[k][order[i]];
    }
}
