/* Plain schoolbook arithmetic on limbs of 32 bits, whose products every C compiler has in 64.
 * Results are cut, not rounded: the error of an operation is below 2^-190 of its result, 24 bits
 * below what the Python model keeps. */
#include "real.h"

#include <math.h>
#include <string.h>

/* Beyond this power of two products are zero, or as large as that: a double is either by then, and
 * exponents of squares of squares would leave their own range. */
enum { LIMB_BITS = 32, GUARDED = REAL_LIMBS + 2, FARTHEST = 1 << 24 };

static const struct real ZERO = {0, 0, {0}};

const struct real REAL_TWO_PI = {
    1, 3, {0x8a67cc74, 0x29024e08, 0x80dc1cd1, 0xc4c6628b, 0x2168c234, 0xc90fdaa2}};

/* 0.work[count - 1] ... work[0] * 2^exponent with the highest bit set and the rest cut off. */
static struct real normalised(int32_t sign, int32_t exponent, const uint32_t *work, int count)
{
    int top = count - 1, shift = 0;
    struct real x = {sign, exponent, {0}};
    while (top >= 0 && work[top] == 0)
        --top;
    if (top < 0)
        return ZERO;
    while (!((work[top] << shift) & 0x80000000u))
        ++shift;
    x.exponent -= LIMB_BITS * (count - 1 - top) + shift;
    for (int i = 0; i < REAL_LIMBS; ++i) {
        const int from = top - i;
        const uint32_t high = from >= 0 ? work[from] : 0;
        const uint32_t low = from >= 1 ? work[from - 1] : 0;
        x.limb[REAL_LIMBS - 1 - i] = shift ? high << shift | low >> (LIMB_BITS - shift) : high;
    }
    return x;
}

struct real real_of(double x)
{
    int exponent;
    const double part = frexp(fabs(x), &exponent);
    const uint64_t bits = (uint64_t)ldexp(part, 64);
    struct real result = {x < 0.0 ? -1 : 1, exponent, {0}};
    if (x == 0.0)
        return ZERO;
    result.limb[REAL_LIMBS - 1] = (uint32_t)(bits >> LIMB_BITS);
    result.limb[REAL_LIMBS - 2] = (uint32_t)bits;
    return result;
}

double real_double(struct real x)
{
    uint64_t bits = (uint64_t)x.limb[REAL_LIMBS - 1] << LIMB_BITS | x.limb[REAL_LIMBS - 2];
    if (x.sign == 0)
        return 0.0;
    for (int i = 0; i < REAL_LIMBS - 2; ++i)
        if (x.limb[i])
            bits |= 1; /* a tie is none if anything follows */
    return x.sign * ldexp((double)bits, x.exponent - 64);
}

/* Whether |a| < |b|. */
static bool smaller(const struct real *a, const struct real *b)
{
    if (a->sign == 0 || b->sign == 0)
        return a->sign == 0 && b->sign != 0;
    if (a->exponent != b->exponent)
        return a->exponent < b->exponent;
    for (int i = REAL_LIMBS - 1; i >= 0; --i)
        if (a->limb[i] != b->limb[i])
            return a->limb[i] < b->limb[i];
    return false;
}

/* The limbs of x shifted down by some bits, between a limb for what falls off and one for carry. */
static void spread(const struct real *x, int64_t bits, uint32_t work[GUARDED])
{
    const int limbs = (int)(bits / LIMB_BITS), rest = (int)(bits % LIMB_BITS);
    for (int i = 0; i < GUARDED; ++i) {
        const int from = i - 1 + limbs;
        const uint32_t low = from >= 0 && from < REAL_LIMBS ? x->limb[from] : 0;
        const uint32_t high = from + 1 >= 0 && from + 1 < REAL_LIMBS ? x->limb[from + 1] : 0;
        work[i] = rest ? low >> rest | high << (LIMB_BITS - rest) : low;
    }
}

struct real real_add(struct real a, struct real b)
{
    uint32_t left[GUARDED], right[GUARDED];
    int64_t carry = 0, distance;
    if (smaller(&a, &b)) {
        const struct real kept = a;
        a = b;
        b = kept;
    }
    distance = (int64_t)a.exponent - b.exponent;
    if (b.sign == 0 || distance > LIMB_BITS * (REAL_LIMBS + 1))
        return a;
    spread(&a, 0, left);
    spread(&b, distance, right);
    for (int i = 0; i < GUARDED; ++i) {
        carry += (int64_t)left[i] + (a.sign == b.sign ? (int64_t)right[i] : -(int64_t)right[i]);
        left[i] = (uint32_t)carry;
        carry = carry < 0 ? -1 : carry >> LIMB_BITS;
    }
    return normalised(a.sign, a.exponent + LIMB_BITS, left, GUARDED);
}

struct real real_subtract(struct real a, struct real b)
{
    return real_add(a, real_negate(b));
}

struct real real_multiply(struct real a, struct real b)
{
    uint32_t product[2 * REAL_LIMBS] = {0};
    int32_t exponent = a.exponent + b.exponent;
    if (a.sign == 0 || b.sign == 0 || exponent < -FARTHEST)
        return ZERO;
    exponent = exponent < FARTHEST ? exponent : FARTHEST;
    for (int i = 0; i < REAL_LIMBS; ++i) {
        uint64_t carry = 0;
        for (int j = 0; j < REAL_LIMBS; ++j) {
            carry += (uint64_t)a.limb[i] * b.limb[j] + product[i + j];
            product[i + j] = (uint32_t)carry;
            carry >>= LIMB_BITS;
        }
        product[i + REAL_LIMBS] = (uint32_t)carry;
    }
    return normalised(a.sign * b.sign, exponent, product, 2 * REAL_LIMBS);
}

/* Newton's r (2 - x r) doubles the digits of a double twice; x must not be zero. */
struct real real_reciprocal(struct real x)
{
    const int32_t exponent = x.exponent;
    const struct real one = real_of(1.0);
    struct real r;
    x.exponent = 0;
    r = real_of(1.0 / real_double(x));
    for (int i = 0; i < 2; ++i)
        r = real_add(r, real_multiply(r, real_subtract(one, real_multiply(x, r))));
    r.exponent -= exponent;
    return r;
}

/* x times Newton's 1/sqrt(x); x must not be negative. */
struct real real_sqrt(struct real x)
{
    const int32_t odd = x.exponent & 1, exponent = x.exponent - odd;
    const struct real one = real_of(1.0);
    struct real r;
    if (x.sign == 0)
        return ZERO;
    x.exponent = odd;
    r = real_of(1.0 / sqrt(real_double(x)));
    for (int i = 0; i < 2; ++i) {
        const struct real left = real_subtract(one, real_multiply(x, real_multiply(r, r)));
        r = real_add(r, real_half(real_multiply(r, left)));
    }
    r = real_multiply(x, r);
    r.exponent += exponent / 2;
    return r;
}

struct real real_negate(struct real x)
{
    x.sign = -x.sign;
    return x;
}

struct real real_abs(struct real x)
{
    x.sign = x.sign != 0;
    return x;
}

struct real real_half(struct real x)
{
    return real_scale(x, -1);
}

struct real real_scale(struct real x, int32_t power)
{
    if (x.sign)
        x.exponent += power;
    return x;
}

bool real_at_most(struct real a, struct real b)
{
    return real_subtract(a, b).sign <= 0;
}
