/* What lies beyond the cut of a chain of sidebands: bounds from scalars alone. What they follow from
 * is in fmu_src/modes_tails.py. */
#ifndef MODES_TAILS_H
#define MODES_TAILS_H

#include "modes_equations.h"

/* No more steps of the recursion than this, where nothing else bounds. */
enum { MOST_BOUNDED = 200000 };

/* The equations of a solver: the full ones, or those of the envelope in a frame turning at centre,
 * which has c^2 + 2 c (v - c) for v^2 and c D for v D. */
struct frame {
    bool rotating;
    double centre, pump_hz;
};

/* The sidebands on one side of a tone, upwards or downwards by sign, counted from 1. */
struct side {
    const struct matrices *m;
    const struct frame *frame;
    double u, sign, half_pump;
};

/* Beyond the sideband end, the first from the asked one on that has them: bounds of |S^-1| of the
 * next one, and of the sum of |X| of all beyond over |X_end|. */
struct tail {
    int32_t end;
    double schur, rest;
};

struct side side_of(const struct matrices *m, const struct frame *frame, double u, int sign);
/* After how many sidebands a part of the carrier may be left, at most most. */
int side_guess(const struct side *side, double wanted, int most);
/* Refuses where the bounds would have to be looked for too far. */
bool side_tail(const struct side *side, int end, struct tail *tail, struct report *report);

#endif
