/* Steady state of N modes: one linear solve, or harmonic balance over the pump's sidebands. The
 * derivation, and what bounds the cut of the sidebands, is in fmu_src/modes_steady.py. */
#ifndef MODES_STEADY_H
#define MODES_STEADY_H

#include "modes_tails.h"

/* Least and largest error that may be asked for; the least is as exact as doubles are. */
#define LEAST_TOLERANCE 1e-14
#define MOST_TOLERANCE 0.1
/* No more sidebands on a side than this. */
enum { MOST_SIDEBANDS = 1500, CHAIN_LENGTH = 2 * MOST_SIDEBANDS + 1 };

/* Response to exp(2 pi i u t), in s^2 times (2 pi)^2: X_k for k = -below to above, and without a pump
 * X_0 in all digits; how far, at most, all together are from those of the endless chain. */
struct steady {
    double u, bound;
    int32_t below, above;
    struct precise_vector carrier;
    struct vector sideband[CHAIN_LENGTH];
};

/* A block in doubles and what the elimination leaves of it: S_k^-1, and R_k of X_k = R_k X_(k-1). */
struct block {
    struct matrix own, inverse, ratio;
    struct precise_vector right, found;
    struct vector rest;
};

/* Bounds of one side: |R_k|, |X_k|/|X_0|, |block (k, k)| of the inverse, and the sums over all i of
 * |block (i, k)|. */
struct spread {
    int most;
    double ratio[MOST_SIDEBANDS + 1], reach[MOST_SIDEBANDS + 1], own[MOST_SIDEBANDS + 1];
    double column[MOST_SIDEBANDS + 1];
};

/* Room for the work, used again by each response. */
struct chain {
    struct matrix half_pump;
    struct spread spread[2]; /* above and below */
    struct block block[CHAIN_LENGTH];
};

/* A change of what a response depends on, matrices row by row. */
struct steady_change {
    struct real stiffness[MODES * MODES], pump[MODES * MODES], damping[MODES], g[MODES];
    double centre, u, pump_hz;
};

struct vector steady_sideband(const struct steady *steady, int k);
/* A(v) for v = u + k pump_hz. */
struct precise_matrix block_at(const struct matrices *m, const struct frame *frame, double u, int k);
bool steady_of(const struct matrices *m, const struct frame *frame, const struct parameters *p,
               double u, struct chain *chain, struct steady *steady, struct report *report);
/* What it does to X_-1, X_0 and X_1 of a pumped response; the chain is used again. Doubles do where
 * less than they hold is asked for. */
bool steady_tangent(const struct matrices *m, const struct frame *frame,
                    const struct steady_change *change, const struct steady *steady,
                    double tolerance, struct chain *chain, struct vector dx[3]);

#endif
