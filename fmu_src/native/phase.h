/* Phases of long runs: the fractional part of frequency times time, to a double's last bit. */
#ifndef PHASE_H
#define PHASE_H

/* A frequency in Hz as the sum of two doubles, with the halves of the first ready. */
struct frequency {
    double high, low, high_high, high_low;
};

/* A time since an origin as the unevaluated sum of two doubles. */
struct span {
    double high, low;
};

struct frequency frequency_of(double high, double low);
double frequency_cycles(const struct frequency *f, double t, double t_low);
struct span span_between(double t, double origin);
double kept_phase(double offset, double before, double after, double t);

#endif
