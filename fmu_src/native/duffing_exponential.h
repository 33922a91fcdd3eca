/* An exponential Runge-Kutta step of order four with an error estimate and values in between. See
 * fmu_src/duffing_exponential.py. */
#ifndef DUFFING_EXPONENTIAL_H
#define DUFFING_EXPONENTIAL_H

#include "oscillator_equations.h"

/* y at a part of a step: coefficients of y and of n at beginning, middle (twice) and end. */
struct spread {
    struct complex turn, begin, middle, end;
};

/* The coefficients of one component for one step size. */
struct weights {
    struct complex half, half_first, half_second, full_first, full_second;
    struct spread full, probe;
    double missed;
};

/* n at the beginning, (twice, added) in the middle and at the end, for one component. */
struct slopes {
    struct complex begin, middle, end;
};

struct step {
    double t, h;
    struct pair y, y_end, n_end;
    struct slopes slopes[2];
    double largest[2], error[2]; /* the largest |Q| met, and how far off the end may be */
};

/* Where a step begins, and what the slope takes as its last argument at probe, middle and end. */
struct beginning {
    double t;
    struct pair y, n, probed, middle, there;
};

/* n and Q from y and the linear response. */
typedef void slope_function(const void *model, const struct pair *y, const struct pair *linear,
                            struct pair *n, struct pair *q);

double probe_place(void);
/* The largest power of 2^(1/4) up to a step size. */
double notched(double h);
struct weights weights_of(struct complex rate, double h);
struct step step_from(const struct beginning *from, double h, const struct weights weights[2],
                      slope_function *slope, const void *model);
/* y at a time within the step. */
struct pair step_between(const struct step *step, const struct complex rates[2], double t);

#endif
