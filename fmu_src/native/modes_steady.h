/* Steady state of N modes: one linear solve, or harmonic balance over the pump's sidebands. The
 * derivation, and what bounds the cut of the sidebands, is in fmu_src/modes_steady.py. */
#ifndef MODES_STEADY_H
#define MODES_STEADY_H

#include "modes_equations.h"

/* No more sidebands on a side than this, and none of the scalar bounds beyond this many. */
enum {
    MOST_SIDEBANDS = 1500,
    CHAIN_LENGTH = 2 * MOST_SIDEBANDS + 1,
    MOST_BOUNDED = 200000
};

/* The equations of a solver: the full ones, or those of the envelope in a frame turning at centre,
 * which has c^2 + 2 c (v - c) for v^2 and c D for v D. */
struct frame {
    bool rotating;
    double centre, pump_hz;
};

/* Response to exp(2 pi i u t), in s^2 times (2 pi)^2: X_k for k = -below to above, and X_0 in all
 * digits; how far, at most, all together are from those of the endless chain. */
struct steady {
    double u, bound;
    int32_t below, above;
    struct precise_vector carrier;
    struct vector sideband[CHAIN_LENGTH];
};

/* What the elimination leaves of one block: S_k^-1, and R_k of X_k = R_k X_(k-1). */
struct block {
    struct matrix inverse, ratio;
    struct precise_vector right, found;
    struct vector rest;
};

/* The scalar bounds s_k of one side, k = least + 1 to last; beyond, the last one holds. */
struct tail {
    int32_t least, last;
    double half_pump, s[MOST_BOUNDED + 2];
};

/* Room for the work, used again by each response. */
struct chain {
    struct matrix half_pump;
    struct tail tail[2];
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
bool steady_of(const struct matrices *m, const struct frame *frame, const double *g, double u,
               struct chain *chain, struct steady *steady, struct report *report);
/* What it does to X_-1, X_0 and X_1 of a pumped response; the chain is used again. */
bool steady_tangent(const struct matrices *m, const struct frame *frame,
                    const struct steady_change *change, const struct steady *steady,
                    struct chain *chain, struct vector dx[3]);

#endif
