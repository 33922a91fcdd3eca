/* exp(2 pi G t) applied to vectors, in 192 bits: nothing accumulates, no eigenvalue is needed. */
#ifndef PROPAGATOR_H
#define PROPAGATOR_H

#include "real.h"

/* Propagators in store: a host that steps evenly needs one, one with two rates two. */
enum { MOST_STATES = 36, MOST_KNOWN = 4 };

/* Rows of a square matrix, one after the other, as many as the propagator has states. */
struct real_matrix {
    struct real x[MOST_STATES * MOST_STATES];
};

struct known {
    struct real span;
    struct real_matrix matrix;
};

struct propagator {
    int32_t size, known_count;
    struct real norm;
    struct real_matrix rows; /* 2 pi G */
    struct known known[MOST_KNOWN];
};

/* Begin with no propagator in store; rows are those of G. */
void propagator_make(struct propagator *propagator, const struct real *rows, int size);
/* Put exp(2 pi G dt) y in the place of y. */
void propagator_move(struct propagator *propagator, struct real *y, struct real dt);

#endif
