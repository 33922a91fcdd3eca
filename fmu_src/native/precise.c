#include "precise.h"

#define SETTLED 1e-46 /* the step of the Python model's iteration, which has 50 digits */
#define ROUNDS 60

struct precise precise_of(double re, double im)
{
    const struct precise z = {real_of(re), real_of(im)};
    return z;
}

struct precise precise_of_complex(struct complex z)
{
    return precise_of(z.re, z.im);
}

struct complex precise_complex(struct precise z)
{
    return complex_of(real_double(z.re), real_double(z.im));
}

struct precise precise_add(struct precise a, struct precise b)
{
    const struct precise z = {real_add(a.re, b.re), real_add(a.im, b.im)};
    return z;
}

struct precise precise_subtract(struct precise a, struct precise b)
{
    const struct precise z = {real_subtract(a.re, b.re), real_subtract(a.im, b.im)};
    return z;
}

struct precise precise_multiply(struct precise a, struct precise b)
{
    const struct precise z = {
        real_subtract(real_multiply(a.re, b.re), real_multiply(a.im, b.im)),
        real_add(real_multiply(a.re, b.im), real_multiply(a.im, b.re)),
    };
    return z;
}

struct precise precise_divide(struct precise a, struct precise b)
{
    const struct real scale = real_reciprocal(
        real_add(real_multiply(b.re, b.re), real_multiply(b.im, b.im)));
    const struct precise top = precise_multiply(a, precise_conjugate(b));
    const struct precise z = {real_multiply(top.re, scale), real_multiply(top.im, scale)};
    return z;
}

struct precise precise_negate(struct precise a)
{
    const struct precise z = {real_negate(a.re), real_negate(a.im)};
    return z;
}

struct precise precise_conjugate(struct precise a)
{
    const struct precise z = {a.re, real_negate(a.im)};
    return z;
}

bool precise_is_zero(struct precise a)
{
    return a.re.sign == 0 && a.im.sign == 0;
}

/* The principal root, without cancellation for either sign of the real part. */
struct precise precise_sqrt(struct precise a)
{
    struct precise z;
    struct real modulus, half, other;
    if (precise_is_zero(a))
        return a;
    modulus = real_sqrt(real_add(real_multiply(a.re, a.re), real_multiply(a.im, a.im)));
    half = real_sqrt(real_half(real_add(modulus, real_abs(a.re))));
    other = real_half(real_multiply(a.im, real_reciprocal(half)));
    if (a.re.sign >= 0) {
        z.re = half;
        z.im = other;
    } else {
        z.re = real_abs(other);
        z.im = a.im.sign >= 0 ? half : real_negate(half);
    }
    return z;
}

static struct real size_of(struct precise z)
{
    return real_add(real_abs(z.re), real_abs(z.im));
}

static void swap(struct precise *a, struct precise *b)
{
    const struct precise kept = *a;
    *a = *b;
    *b = kept;
}

/* Bring the row with the largest entry of a column to the diagonal; false where all are 0. */
static bool pivoted(struct precise *rows, struct precise *right, int size, int i)
{
    int best = i;
    for (int k = i + 1; k < size; ++k)
        if (!real_at_most(size_of(rows[size * k + i]), size_of(rows[size * best + i])))
            best = k;
    for (int j = 0; j < size; ++j)
        swap(&rows[size * i + j], &rows[size * best + j]);
    swap(&right[i], &right[best]);
    return !precise_is_zero(rows[size * i + i]);
}

/* a less b times c. */
static struct precise less(struct precise a, struct precise b, struct precise c)
{
    return precise_subtract(a, precise_multiply(b, c));
}

bool precise_solve(struct precise *rows, struct precise *right, int size)
{
    for (int i = 0; i < size; ++i) {
        if (!pivoted(rows, right, size, i))
            return false;
        for (int k = i + 1; k < size; ++k) {
            struct precise factor;
            if (precise_is_zero(rows[size * k + i]))
                continue;
            factor = precise_divide(rows[size * k + i], rows[size * i + i]);
            for (int j = i + 1; j < size; ++j)
                rows[size * k + j] = less(rows[size * k + j], factor, rows[size * i + j]);
            right[k] = less(right[k], factor, right[i]);
        }
    }
    for (int i = size - 1; i >= 0; --i) {
        for (int j = i + 1; j < size; ++j)
            right[i] = less(right[i], rows[size * i + j], right[j]);
        right[i] = precise_divide(right[i], rows[size * i + i]);
    }
    return true;
}

void precise_split(struct precise z, double *high, double *low)
{
    *high = real_double(z.im);
    *low = real_double(real_subtract(z.im, real_of(*high)));
}

struct polynomial polynomial_parabola(struct precise c0, struct precise c1, struct precise c2)
{
    const struct precise zero = precise_of(0.0, 0.0);
    const struct polynomial p = {3, {c0, c1, c2, zero, zero}};
    return p;
}

struct polynomial polynomial_line(struct precise c0, struct precise c1)
{
    struct polynomial p = polynomial_parabola(c0, c1, precise_of(0.0, 0.0));
    p.size = 2;
    return p;
}

struct polynomial polynomial_constant(struct precise c)
{
    struct polynomial p = polynomial_line(c, precise_of(0.0, 0.0));
    p.size = 1;
    return p;
}

struct polynomial polynomial_negate(struct polynomial p)
{
    for (int i = 0; i < p.size; ++i)
        p.c[i] = precise_negate(p.c[i]);
    return p;
}

struct polynomial polynomial_conjugate(struct polynomial p)
{
    for (int i = 0; i < p.size; ++i)
        p.c[i] = precise_conjugate(p.c[i]);
    return p;
}

struct polynomial polynomial_add(struct polynomial a, struct polynomial b)
{
    if (a.size < b.size)
        return polynomial_add(b, a);
    for (int i = 0; i < b.size; ++i)
        a.c[i] = precise_add(a.c[i], b.c[i]);
    return a;
}

struct polynomial polynomial_multiply(struct polynomial a, struct polynomial b)
{
    struct polynomial p = polynomial_constant(precise_of(0.0, 0.0));
    p.size = a.size + b.size - 1;
    for (int i = 0; i < a.size; ++i) {
        if (precise_is_zero(a.c[i]))
            continue;
        for (int j = 0; j < b.size; ++j)
            p.c[i + j] = precise_add(p.c[i + j], precise_multiply(a.c[i], b.c[j]));
    }
    return p;
}

/* By repeated synthetic division, so that coinciding nodes need no limit and no division is made:
 * p(x) = p(n) + (x - n) q(x), and p[n, m] = q(m). */
struct differences polynomial_differences(struct polynomial p, const struct precise *nodes,
                                          int size)
{
    const struct precise zero = precise_of(0.0, 0.0);
    struct differences d = {.size = size};
    for (int i = 0; i < size; ++i) {
        struct polynomial quotient = p;
        d.nodes[i] = nodes[i];
        for (int j = i; j < size; ++j) {
            struct precise value = zero;
            for (int k = quotient.size - 1; k >= 0; --k) {
                const struct precise before = value;
                value = precise_add(precise_multiply(value, nodes[j]), quotient.c[k]);
                quotient.c[k] = before;
            }
            d.t[i][j] = value;
            if (quotient.size > 1)
                --quotient.size;
        }
    }
    return d;
}

/* Leibniz' rule: from f d = p follows f[0..j] d[j] = p[0..j] - sum_{k<j} f[0..k] d[k..j]. */
void rational_differences(struct polynomial numerator, const struct differences *denominator,
                          struct precise *result)
{
    const int size = denominator->size;
    const struct differences top = polynomial_differences(numerator, denominator->nodes, size);
    for (int j = 0; j < size; ++j) {
        struct precise rest = top.t[0][j];
        for (int k = 0; k < j; ++k)
            rest = precise_subtract(rest, precise_multiply(result[k], denominator->t[k][j]));
        result[j] = precise_divide(rest, denominator->t[j][j]);
    }
}

static bool settled(struct precise step, struct precise value)
{
    const struct real moved = real_add(real_abs(step.re), real_abs(step.im));
    const struct real size = real_add(real_abs(value.re), real_abs(value.im));
    return real_at_most(moved, real_multiply(real_of(SETTLED), size));
}

/* Bairstow's Newton iteration with a complex factor: it converges quadratically even where the two
 * roots coincide, because the factor and its conjugate have no root in common. */
bool upper_factor(const struct polynomial *quartic, struct precise *e1, struct precise *e2)
{
    const struct precise *p = quartic->c;
    for (int round = 0; round < ROUNDS; ++round) {
        /* p = (x^2 - e1 x + e2) (x^2 + a x + b) + r1 x + r0 */
        const struct precise a = precise_add(p[3], *e1);
        const struct precise b =
            precise_add(precise_subtract(p[2], *e2), precise_multiply(*e1, a));
        const struct precise r1 = precise_add(precise_subtract(p[1], precise_multiply(*e2, a)),
                                              precise_multiply(*e1, b));
        const struct precise r0 = precise_subtract(p[0], precise_multiply(*e2, b));
        /* the cofactor modulo the factor is m1 x + m0; (m1 x + m0) (y1 x + y0) is to be r */
        const struct precise m1 = precise_add(a, *e1), m0 = precise_subtract(b, *e2);
        const struct precise c = precise_add(m0, precise_multiply(m1, *e1));
        const struct precise m2e2 = precise_multiply(m1, *e2);
        const struct precise determinant =
            precise_add(precise_multiply(c, m0), precise_multiply(m1, m2e2));
        struct precise y1 = precise_subtract(precise_multiply(r1, m0), precise_multiply(r0, m1));
        struct precise y0 = precise_add(precise_multiply(c, r0), precise_multiply(m2e2, r1));
        if (precise_is_zero(determinant))
            return false;
        y1 = precise_divide(y1, determinant);
        y0 = precise_divide(y0, determinant);
        *e1 = precise_subtract(*e1, y1);
        *e2 = precise_add(*e2, y0);
        if (settled(y1, *e1) && settled(y0, *e2))
            return true;
    }
    return false;
}
