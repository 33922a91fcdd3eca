/* Reals of 192 bits: what the coefficients of an exact solver are made with, once per set of
 * parameters. The Python model takes 50 decimal digits (166 bits) for the same work. */
#ifndef REAL_H
#define REAL_H

#include <stdbool.h>
#include <stdint.h>

enum { REAL_LIMBS = 6 };

/* sign * 0.limb[5] limb[4] ... limb[0] * 2^exponent, the highest bit set; sign 0 is zero. */
struct real {
    int32_t sign;
    int32_t exponent;
    uint32_t limb[REAL_LIMBS];
};

extern const struct real REAL_TWO_PI;

struct real real_of(double x);
double real_double(struct real x);
struct real real_add(struct real a, struct real b);
struct real real_subtract(struct real a, struct real b);
struct real real_multiply(struct real a, struct real b);
struct real real_reciprocal(struct real x);
struct real real_sqrt(struct real x);
struct real real_negate(struct real x);
struct real real_abs(struct real x);
struct real real_half(struct real x);
struct real real_scale(struct real x, int32_t power); /* x 2^power */
bool real_at_most(struct real a, struct real b);

#endif
