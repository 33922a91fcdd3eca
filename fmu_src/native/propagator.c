#include "propagator.h"

#include <math.h>
#include <string.h>

/* Steps that differ by less than this angle share a propagator; a short series does the rest. */
#define NEAR 1e-3
/* Series end at this part of the vector: that of a propagator, which is squared and used again and
 * again, and that of the rest of a step. */
#define SERIES_END 1e-50
#define REST_END 1e-36

static struct real largest_of(const struct real *y, int size)
{
    struct real largest = real_abs(y[0]);
    for (int i = 1; i < size; ++i) {
        const struct real next = real_abs(y[i]);
        if (!real_at_most(next, largest))
            largest = next;
    }
    return largest;
}

static void apply(const struct real *rows, const struct real *y, int size, struct real *result)
{
    for (int i = 0; i < size; ++i) {
        struct real total = real_of(0.0);
        for (int j = 0; j < size; ++j)
            if (rows[size * i + j].sign && y[j].sign)
                total = real_add(total, real_multiply(rows[size * i + j], y[j]));
        result[i] = total;
    }
}

void propagator_make(struct propagator *propagator, const struct real *rows, int size)
{
    propagator->size = size;
    propagator->known_count = 0;
    propagator->norm = real_of(0.0);
    for (int i = 0; i < size; ++i) {
        struct real sum = real_of(0.0);
        for (int j = 0; j < size; ++j) {
            struct real *x = &propagator->rows.x[size * i + j];
            *x = real_multiply(REAL_TWO_PI, rows[size * i + j]);
            sum = real_add(sum, real_abs(*x));
        }
        if (!real_at_most(sum, propagator->norm))
            propagator->norm = sum;
    }
}

/* Put the Taylor series of exp(2 pi G dt) y in the place of y. */
static void series(const struct propagator *propagator, struct real *y, struct real dt, double end)
{
    const int size = propagator->size;
    const struct real least = real_multiply(real_of(end), largest_of(y, size));
    struct real term[MOST_STATES], next[MOST_STATES];
    memcpy(term, y, (size_t)size * sizeof *y);
    for (int order = 1; !real_at_most(largest_of(term, size), least); ++order) {
        const struct real part = real_multiply(dt, real_reciprocal(real_of(order)));
        apply(propagator->rows.x, term, size, next);
        for (int i = 0; i < size; ++i) {
            term[i] = real_multiply(part, next[i]);
            y[i] = real_add(y[i], term[i]);
        }
    }
}

/* Column by column by its series over dt/2^s, then squared s times. */
static void exponential(const struct propagator *propagator, struct real dt, struct real_matrix *e)
{
    const int size = propagator->size;
    const double angle = real_double(real_multiply(real_abs(dt), propagator->norm));
    const int needed = angle > 0.0 ? (int)ceil(log2(angle)) + 10 : 0;
    const int squarings = needed > 0 ? needed : 0;
    const struct real part = real_scale(dt, -squarings);
    struct real column[MOST_STATES];
    struct real_matrix squared;
    for (int j = 0; j < size; ++j) {
        for (int i = 0; i < size; ++i)
            column[i] = real_of(i == j ? 1.0 : 0.0);
        series(propagator, column, part, SERIES_END);
        for (int i = 0; i < size; ++i)
            e->x[size * i + j] = column[i];
    }
    for (int k = 0; k < squarings; ++k) {
        for (int j = 0; j < size; ++j) {
            struct real moved[MOST_STATES];
            for (int i = 0; i < size; ++i)
                column[i] = e->x[size * i + j];
            apply(e->x, column, size, moved);
            for (int i = 0; i < size; ++i)
                squared.x[size * i + j] = moved[i];
        }
        memcpy(e->x, squared.x, (size_t)(size * size) * sizeof *e->x);
    }
}

/* A propagator in store over nearly this time, made where there is none. */
static const struct known *known_near(struct propagator *propagator, struct real dt)
{
    const struct real least = real_of(NEAR);
    struct known *first = propagator->known;
    for (int k = 0; k < propagator->known_count; ++k) {
        const struct real apart = real_abs(real_subtract(dt, first[k].span));
        if (real_at_most(real_multiply(apart, propagator->norm), least))
            return &first[k];
    }
    if (propagator->known_count < MOST_KNOWN)
        ++propagator->known_count;
    memmove(first + 1, first, (size_t)(propagator->known_count - 1) * sizeof *first);
    first->span = dt;
    exponential(propagator, dt, &first->matrix);
    return first;
}

void propagator_move(struct propagator *propagator, struct real *y, struct real dt)
{
    const struct known *known = known_near(propagator, dt);
    const struct real rest = real_subtract(dt, known->span);
    struct real moved[MOST_STATES];
    apply(known->matrix.x, y, propagator->size, moved);
    memcpy(y, moved, (size_t)propagator->size * sizeof *y);
    if (rest.sign)
        series(propagator, y, rest, REST_END);
}
