/* Complex doubles, operation by operation as Python calculates them. C's own complex type leaves
 * division, and products of infinities, to each compiler. */
#ifndef COMPLEX_NUMBER_H
#define COMPLEX_NUMBER_H

#include <math.h>
#include <stdbool.h>

#define TWO_PI 6.283185307179586
#define FOUR_PI_SQUARED (TWO_PI * TWO_PI)
#define PI 3.141592653589793

struct complex {
    double re, im;
};

static inline struct complex complex_of(double re, double im)
{
    const struct complex z = {re, im};
    return z;
}

static inline struct complex c_add(struct complex a, struct complex b)
{
    return complex_of(a.re + b.re, a.im + b.im);
}

static inline struct complex c_subtract(struct complex a, struct complex b)
{
    return complex_of(a.re - b.re, a.im - b.im);
}

static inline struct complex c_multiply(struct complex a, struct complex b)
{
    return complex_of(a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re);
}

static inline struct complex c_scale(double a, struct complex b)
{
    return complex_of(a * b.re, a * b.im);
}

static inline struct complex c_conjugate(struct complex a)
{
    return complex_of(a.re, -a.im);
}

static inline bool c_is_zero(struct complex a)
{
    return a.re == 0.0 && a.im == 0.0;
}

static inline double c_abs(struct complex a)
{
    return hypot(a.re, a.im);
}

/* R. L. Smith's quotient (Comm. ACM 5, 435, 1962): no square leaves the range of a double. */
static inline struct complex c_divide(struct complex a, struct complex b)
{
    if (fabs(b.re) >= fabs(b.im)) {
        const double ratio = b.im / b.re, scale = b.re + b.im * ratio;
        return complex_of((a.re + a.im * ratio) / scale, (a.im - a.re * ratio) / scale);
    } else {
        const double ratio = b.re / b.im, scale = b.re * ratio + b.im;
        return complex_of((a.re * ratio + a.im) / scale, (a.im * ratio - a.re) / scale);
    }
}

static inline struct complex c_rect(double size, double angle)
{
    return complex_of(size * cos(angle), size * sin(angle));
}

#endif
