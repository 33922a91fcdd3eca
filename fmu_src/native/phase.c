/* At 10 GHz and 1e4 s a phase counts 1e14 cycles, of which a plain product keeps two decimals. Here
 * the product is an unevaluated sum of two doubles (T. J. Dekker, Numer. Math. 18, 224, 1971), from
 * which the whole cycles drop out exactly. No compiler may contract or reorder this: see the
 * builder's options. */
#include "phase.h"

#include <math.h>

#define SPLITTER 134217729.0 /* 2^27 + 1 */

struct frequency frequency_of(double high, double low)
{
    const double c = SPLITTER * high, upper = c - (c - high);
    const struct frequency f = {high, low, upper, high - upper};
    return f;
}

/* Frequency times (t + t_low) less whole cycles, within [-1/2, 3/2). */
double frequency_cycles(const struct frequency *f, double t, double t_low)
{
    const double product = f->high * t, c = SPLITTER * t;
    const double t_high = c - (c - t), t_rest = t - t_high;
    const double error =
        ((f->high_high * t_high - product) + f->high_high * t_rest + f->high_low * t_high) +
        f->high_low * t_rest;
    return (product - floor(product)) + (error + (f->low * t + f->high * t_low));
}

/* D. E. Knuth's two-sum. */
struct span span_between(double t, double origin)
{
    const double high = t - origin, back = high - t;
    const struct span span = {high, (t - (high - back)) - (origin + back)};
    return span;
}

/* The cycles to add to a tone so that a new frequency continues its phase at t. */
double kept_phase(double offset, double before, double after, double t)
{
    const struct frequency old = frequency_of(before, 0.0), new = frequency_of(after, 0.0);
    double phase;
    if (before == after)
        return offset;
    phase = fmod(offset + frequency_cycles(&old, t, 0.0) - frequency_cycles(&new, t, 0.0), 1.0);
    return phase < 0.0 ? phase + 1.0 : phase;
}
