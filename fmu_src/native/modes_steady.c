/* The blocks are eliminated in doubles from both ends to the middle, in the order of
 * fmu_src/modes_steady.py, then corrected with residuals of all digits. */
#include "modes_steady.h"

#include <string.h>

/* Rounding of a double, relative. */
#define EPSILON 0x1p-53

/* What stands for v^2. */
static struct real square_of(const struct frame *frame, struct real v)
{
    const struct real c = real_of(frame->centre);
    return frame->rotating ? real_multiply(c, real_subtract(real_add(v, v), c))
                           : real_multiply(v, v);
}

struct precise_matrix block_at(const struct matrices *m, const struct frame *frame, double u, int k)
{
    const struct real v = real_add(real_of(u), real_multiply(real_of(k), real_of(frame->pump_hz)));
    const struct real square = square_of(frame, v);
    const struct real carrier = frame->rotating ? real_of(frame->centre) : v;
    struct precise_matrix a;
    memset(&a, 0, sizeof a);
    for (int i = 0; i < MODES; ++i) {
        for (int j = 0; j < MODES; ++j)
            a.x[i][j].re = m->stiffness[i][j];
        a.x[i][i].re = real_subtract(a.x[i][i].re, square);
        a.x[i][i].im = real_multiply(carrier, m->damping[i]);
    }
    return a;
}

struct vector steady_sideband(const struct steady *steady, int k)
{
    struct vector none;
    memset(&none, 0, sizeof none);
    return -steady->below <= k && k <= steady->above ? steady->sideband[MOST_SIDEBANDS + k] : none;
}

static struct block *block_of(struct chain *chain, int k)
{
    return &chain->block[MOST_SIDEBANDS + k];
}

/* --- the chain -------------------------------------------------------------------------------- */

static void halve_pump(const struct matrices *m, struct chain *chain)
{
    for (int i = 0; i < MODES; ++i)
        for (int j = 0; j < MODES; ++j)
            chain->half_pump.x[i][j] = complex_of(0.5 * m->pump_values[i][j], 0.0);
}

/* A(v_k) in doubles, but for rounding that of all digits. */
static struct matrix rounded_block(const struct matrices *m, const struct frame *frame, double u,
                                   int k)
{
    const struct real v = real_add(real_of(u), real_multiply(real_of(k), real_of(frame->pump_hz)));
    const struct real square = square_of(frame, v);
    const double carrier = frame->rotating ? frame->centre : real_double(v);
    struct matrix a;
    for (int i = 0; i < MODES; ++i) {
        for (int j = 0; j < MODES; ++j)
            a.x[i][j] = complex_of(m->stiffness_values[i][j], 0.0);
        a.x[i][i].re = real_double(real_subtract(m->stiffness[i][i], square));
        a.x[i][i].im = carrier * m->damping_values[i];
    }
    return a;
}

/* A(v_k) + C_p/2 R_j summed over the neighbours j further out, inverted. */
static bool eliminate(const struct matrices *m, const struct frame *frame,
                      const struct steady *steady, int k, struct chain *chain)
{
    struct block *block = block_of(chain, k);
    struct matrix rows = block->own = rounded_block(m, frame, steady->u, k);
    for (int side = 1; side >= -1; side -= 2) {
        const int outer = k + side;
        struct matrix added;
        if (k * side < 0 || outer > steady->above || outer < -steady->below)
            continue;
        added = matrix_product(&chain->half_pump, &block_of(chain, outer)->ratio);
        for (int i = 0; i < MODES; ++i)
            for (int j = 0; j < MODES; ++j)
                rows.x[i][j] = c_add(rows.x[i][j], added.x[i][j]);
    }
    return matrix_inverse(&rows, &block->inverse);
}

static void lead(struct chain *chain, int k)
{
    struct block *block = block_of(chain, k);
    block->ratio = matrix_product(&block->inverse, &chain->half_pump);
    for (int i = 0; i < MODES; ++i)
        for (int j = 0; j < MODES; ++j)
            block->ratio.x[i][j] = c_scale(-1.0, block->ratio.x[i][j]);
}

static bool eliminated(const struct matrices *m, const struct frame *frame,
                       const struct steady *steady, struct chain *chain)
{
    for (int sign = 1; sign >= -1; sign -= 2)
        for (int k = sign > 0 ? steady->above : steady->below; k > 0; --k) {
            if (!eliminate(m, frame, steady, sign * k, chain))
                return false;
            lead(chain, sign * k);
        }
    return eliminate(m, frame, steady, 0, chain);
}

static struct vector plus(struct vector a, const struct vector *b)
{
    for (int i = 0; i < MODES; ++i)
        a.x[i] = c_add(a.x[i], b->x[i]);
    return a;
}

/* What the equations leave of a right side, to each block's rest. */
static void write_rest(const struct matrices *m, const struct frame *frame,
                       const struct steady *steady, struct chain *chain)
{
    for (int k = -steady->below; k <= steady->above; ++k) {
        const struct precise_matrix a = block_at(m, frame, steady->u, k);
        const struct precise *own = block_of(chain, k)->found.x;
        for (int i = 0; i < MODES; ++i) {
            struct precise rest = block_of(chain, k)->right.x[i];
            for (int j = 0; j < MODES; ++j) {
                const struct real weight = real_half(m->pump[i][j]);
                rest = precise_subtract(rest, precise_multiply(a.x[i][j], own[j]));
                for (int side = -1; side <= 1 && weight.sign; side += 2) {
                    const struct precise *other;
                    if (k + side < -steady->below || k + side > steady->above)
                        continue;
                    other = &block_of(chain, k + side)->found.x[j];
                    rest.re = real_subtract(rest.re, real_multiply(weight, other->re));
                    rest.im = real_subtract(rest.im, real_multiply(weight, other->im));
                }
            }
            block_of(chain, k)->rest.x[i] = precise_complex(rest);
        }
    }
}

/* Put the solution in doubles for the blocks' rest in its place. */
static void solve_in_doubles(const struct steady *steady, struct chain *chain)
{
    struct vector added;
    for (int sign = 1; sign >= -1; sign -= 2)
        for (int k = sign > 0 ? steady->above : steady->below; k > 0; --k) {
            const struct block *block = block_of(chain, sign * k);
            struct block *inner = block_of(chain, sign * (k - 1));
            /* (C_p/2 S^-1)^T = S^-1 C_p/2, both are symmetric */
            added = matrix_transposed_applied(&block->ratio, &block->rest);
            inner->rest = plus(inner->rest, &added);
        }
    block_of(chain, 0)->rest =
        matrix_applied(&block_of(chain, 0)->inverse, &block_of(chain, 0)->rest);
    for (int sign = 1; sign >= -1; sign -= 2)
        for (int k = 1; k <= (sign > 0 ? steady->above : steady->below); ++k) {
            struct block *block = block_of(chain, sign * k);
            const struct vector own = matrix_applied(&block->inverse, &block->rest);
            added = matrix_applied(&block->ratio, &block_of(chain, sign * (k - 1))->rest);
            block->rest = plus(own, &added);
        }
}

/* Correct what was found for the blocks' right sides by residuals of all digits, until doubles can
 * hold no more. */
static bool corrected(const struct matrices *m, const struct frame *frame,
                      const struct steady *steady, struct chain *chain)
{
    double before = 0.0;
    for (int k = -steady->below; k <= steady->above; ++k) {
        const struct vector x = precise_vector_rounded(&block_of(chain, k)->found);
        before = fmax(before, vector_largest(&x));
    }
    for (;;) {
        double size = 0.0, largest = 0.0;
        write_rest(m, frame, steady, chain);
        solve_in_doubles(steady, chain);
        for (int k = -steady->below; k <= steady->above; ++k) {
            struct block *block = block_of(chain, k);
            for (int i = 0; i < MODES; ++i) {
                const struct precise change = precise_of_complex(block->rest.x[i]);
                block->found.x[i] = precise_add(block->found.x[i], change);
                largest = fmax(largest, c_abs(precise_complex(block->found.x[i])));
            }
            size = fmax(size, vector_largest(&block->rest));
        }
        /* each change is as much smaller than the one before as this one was */
        if (size * size <= 1e-19 * largest * before)
            return true;
        if (!(size < 0.1 * before))
            return false;
        before = size;
    }
}

/* --- what the cut and rounding cost ------------------------------------------------------------ */

static void spread_of(struct chain *chain, int sign, int most, struct spread *spread)
{
    double *own = spread->own;
    spread->most = most;
    spread->reach[0] = 1.0;
    own[0] = matrix_norm(&block_of(chain, 0)->inverse);
    for (int k = 1; k <= most; ++k) {
        const struct block *block = block_of(chain, sign * k);
        const double ratio = spread->ratio[k] = matrix_norm(&block->ratio);
        spread->reach[k] = spread->reach[k - 1] * ratio;
        own[k] = matrix_norm(&block->inverse) + ratio * ratio * own[k - 1];
    }
}

/* Outwards the blocks of a column fall by |R_i|, inwards they are those of a row, as the inverse is
 * symmetric; on the other side they are |X_i|/|X_0| times that in the middle. */
static void write_columns(struct spread *spread, const struct spread *other)
{
    double *column = spread->column, inner = 0.0;
    column[spread->most] = 1.0;
    for (int k = spread->most; k > 0; --k)
        column[k - 1] = 1.0 + spread->ratio[k] * column[k];
    for (int k = 1; k <= other->most; ++k)
        inner += other->reach[k];
    inner *= spread->own[0];
    column[0] = spread->own[0] * column[0] + inner;
    for (int k = 1; k <= spread->most; ++k) {
        inner = spread->ratio[k] * (inner + spread->own[k - 1]);
        column[k] = spread->own[k] * column[k] + inner;
    }
}

static struct vector driven(const double *g, int k)
{
    struct vector x;
    for (int i = 0; i < MODES; ++i)
        x.x[i] = complex_of(k == 0 ? g[i] : 0.0, 0.0);
    return x;
}

/* A bound of the 2-norm of what the equations of a block leave: of sums of 3 n + 1 products of
 * doubles, and of entries of A that are rounded. */
static double rest_of(const struct matrices *m, const double *g, const struct steady *steady,
                      struct chain *chain, int k)
{
    const struct vector before = steady_sideband(steady, k - 1), x = steady_sideband(steady, k);
    const struct vector after = steady_sideband(steady, k + 1), push = driven(g, k);
    const double least = 8.0 * (MODES + 2) * EPSILON;
    const struct matrix *own = &block_of(chain, k)->own;
    const struct vector sides = plus(before, &after), pushed = matrix_applied(own, &x);
    const struct vector tied = matrix_applied(&chain->half_pump, &sides);
    const double size = matrix_norm(own) * vector_norm(&x) +
                        0.5 * m->pump_norm * (vector_norm(&before) + vector_norm(&after));
    struct vector left;
    for (int i = 0; i < MODES; ++i)
        left.x[i] = c_subtract(c_subtract(push.x[i], pushed.x[i]), tied.x[i]);
    return vector_norm(&left) + least * (size + vector_norm(&push));
}

/* What the cut costs at most, over |X| at the ends, and what rounding does, each over all sidebands;
 * infinite where no bound holds. */
struct errors {
    double cut, rounding;
};

static struct errors errors_of(const struct matrices *m, const double *g,
                               const struct steady *steady, const struct tail tails[2],
                               struct chain *chain)
{
    struct spread *high = &chain->spread[0], *low = &chain->spread[1];
    const double quarter = 0.25 * (m->pump_norm * m->pump_norm);
    const double above = quarter * tails[0].schur, below = quarter * tails[1].schur;
    struct errors errors = {INFINITY, 0.0};
    double across, feedback, high_own, low_own;
    spread_of(chain, 1, steady->above, high);
    spread_of(chain, -1, steady->below, low);
    write_columns(high, low);
    write_columns(low, high);
    for (int k = -steady->below; k <= steady->above; ++k)
        errors.rounding +=
            (k > 0 ? high->column[k] : low->column[-k]) * rest_of(m, g, steady, chain, k);
    errors.rounding *= 1.01; /* of norms that are known to some digits alone */
    high_own = high->own[high->most];
    low_own = low->own[low->most];
    across = high->reach[high->most] * high->own[0] * low->reach[low->most];
    feedback = fmax(high_own * above + across * below, across * above + low_own * below);
    if (feedback < 0.5)
        errors.cut = (above * high->column[high->most] + below * low->column[low->most] +
                      (tails[0].rest + tails[1].rest)) /
                     (1.0 - feedback);
    return errors;
}

/* How far all sidebands together may be off: relative to the read-out, or the displacement, at the
 * tone's own frequency, but no more than doubles hold of the largest sideband. */
static double allowed(const struct parameters *p, const struct steady *steady, double largest)
{
    const struct vector x = steady_sideband(steady, 0);
    struct complex seen = {0.0, 0.0};
    double size = vector_norm(&x);
    for (int i = 0; i < MODES; ++i)
        seen = c_add(seen, c_scale(p->readout[i], x.x[i]));
    if (!c_is_zero(seen))
        size = fmin(size, c_abs(seen) / norm_of(p->readout, MODES));
    return fmax(p->tolerance * size, LEAST_TOLERANCE * largest);
}

/* --- responses --------------------------------------------------------------------------------- */

/* The solution in doubles for a unit tone on the gains. */
static void solve_unit(const double *g, struct chain *chain, struct steady *steady)
{
    struct vector *x = steady->sideband + MOST_SIDEBANDS;
    const struct vector push = driven(g, 0);
    x[0] = matrix_applied(&block_of(chain, 0)->inverse, &push);
    for (int sign = 1; sign >= -1; sign -= 2)
        for (int k = 1; k <= (sign > 0 ? steady->above : steady->below); ++k)
            x[sign * k] = matrix_applied(&block_of(chain, sign * k)->ratio, &x[sign * (k - 1)]);
}

static bool correct_unit(const struct matrices *m, const struct frame *frame, const double *g,
                         struct chain *chain, struct steady *steady)
{
    for (int k = -steady->below; k <= steady->above; ++k) {
        struct block *block = block_of(chain, k);
        for (int i = 0; i < MODES; ++i) {
            block->right.x[i] = precise_of(k == 0 ? g[i] : 0.0, 0.0);
            block->found.x[i] = precise_of_complex(steady->sideband[MOST_SIDEBANDS + k].x[i]);
        }
    }
    if (!corrected(m, frame, steady, chain))
        return false;
    for (int k = -steady->below; k <= steady->above; ++k)
        steady->sideband[MOST_SIDEBANDS + k] =
            precise_vector_rounded(&block_of(chain, k)->found);
    return true;
}

static double ends_of(const struct steady *steady)
{
    return fmax(vector_norm(&steady->sideband[MOST_SIDEBANDS - steady->below]),
                vector_norm(&steady->sideband[MOST_SIDEBANDS + steady->above]));
}

/* Solve a chain of this length, correct it where rounding costs more than is asked for; whether its
 * bound, which is written, is what was asked for. */
static bool long_enough(const struct matrices *m, const struct frame *frame,
                        const struct parameters *p, const struct tail tails[2],
                        struct chain *chain, struct steady *steady, bool *solvable)
{
    double total = 0.0, largest = 0.0, ends, most;
    struct errors errors;
    *solvable = eliminated(m, frame, steady, chain);
    if (!*solvable)
        return false;
    solve_unit(p->g, chain, steady);
    for (int k = -steady->below; k <= steady->above; ++k) {
        const double size = vector_norm(&steady->sideband[MOST_SIDEBANDS + k]);
        total += size;
        largest = fmax(largest, size);
    }
    errors = errors_of(m, p->g, steady, tails, chain);
    most = allowed(p, steady, largest);
    ends = ends_of(steady);
    if (ends * errors.cut <= most &&
        !((ends + errors.rounding) * errors.cut + errors.rounding <= most)) {
        *solvable = correct_unit(m, frame, p->g, chain, steady);
        if (!*solvable)
            return false;
        errors.rounding = 0.0;
        ends = ends_of(steady);
    }
    steady->bound = (ends + errors.rounding) * errors.cut + errors.rounding;
    if (!(steady->bound <= most))
        return false;
    /* and the way to the outputs: amplitude, phase, sum over the modes */
    steady->bound += (MODES + 12) * EPSILON * total;
    return true;
}

/* The response under the pump, from a chain that is long enough. */
static bool pumped_steady(const struct matrices *m, const struct frame *frame,
                          const struct parameters *p, struct chain *chain, struct steady *steady,
                          struct report *report)
{
    const struct side up = side_of(m, frame, steady->u, 1);
    const struct side down = side_of(m, frame, steady->u, -1);
    struct tail tails[2];
    bool solvable = true;
    halve_pump(m, chain);
    steady->above = side_guess(&up, 0.5 * p->tolerance, MOST_SIDEBANDS);
    steady->below = side_guess(&down, 0.5 * p->tolerance, MOST_SIDEBANDS);
    while (solvable) {
        if (!side_tail(&up, steady->above, &tails[0], report) ||
            !side_tail(&down, steady->below, &tails[1], report))
            return false;
        steady->above = tails[0].end;
        steady->below = tails[1].end;
        if (steady->above > MOST_SIDEBANDS || steady->below > MOST_SIDEBANDS)
            return refuse(report,
                          "the pump at pump_hz = %r Hz needs more than %d sidebands of a drive at "
                          "%r Hz: a faster or a weaker pump is wanted",
                          frame->pump_hz, MOST_SIDEBANDS, steady->u);
        if (long_enough(m, frame, p, tails, chain, steady, &solvable))
            return true;
        steady->above += 1 + steady->above / 4;
        steady->below += 1 + steady->below / 4;
    }
    return refuse(report,
                  "the sidebands of the pump at pump_hz = %r Hz cannot be solved for: the modes are "
                  "too close to undamped, or to instability",
                  frame->pump_hz);
}

bool steady_of(const struct matrices *m, const struct frame *frame, const struct parameters *p,
               double u, struct chain *chain, struct steady *steady, struct report *report)
{
    struct precise_matrix block;
    steady->u = u;
    if (m->pump_norm != 0.0)
        return pumped_steady(m, frame, p, chain, steady, report);
    steady->below = steady->above = 0;
    steady->bound = 0.0;
    block = block_at(m, frame, u, 0);
    for (int i = 0; i < MODES; ++i)
        steady->carrier.x[i] = precise_of(p->g[i], 0.0);
    if (!precise_solve(&block.x[0][0], steady->carrier.x, MODES))
        return refuse(report,
                      "a drive at %r Hz has no steady state: it lies on an undamped eigenfrequency",
                      u);
    steady->sideband[MOST_SIDEBANDS] = precise_vector_rounded(&steady->carrier);
    return true;
}

/* --- what a change does -------------------------------------------------------------------------- */

/* Take from a block's right side what a matrix makes of a sideband. */
static void take(const struct real *rows, bool halved, const struct vector *x,
                 struct precise_vector *right)
{
    for (int i = 0; i < MODES; ++i)
        for (int j = 0; j < MODES; ++j) {
            const struct real factor =
                halved ? real_half(rows[MODES * i + j]) : rows[MODES * i + j];
            const struct precise z = precise_of_complex(x->x[j]);
            right->x[i].re = real_subtract(right->x[i].re, real_multiply(factor, z.re));
            right->x[i].im = real_subtract(right->x[i].im, real_multiply(factor, z.im));
        }
}

/* What the change leaves of a block's equations: dg - dA X_k - dC_p/2 (X_(k-1) + X_(k+1)). */
static void change_block(const struct matrices *m, const struct frame *frame,
                         const struct steady_change *change, const struct steady *steady, int k,
                         struct precise_vector *right)
{
    const double c = frame->centre, dc = change->centre;
    const double v = steady->u + k * frame->pump_hz, dv = change->u + k * change->pump_hz;
    const double square =
        frame->rotating ? dc * (2.0 * v - c) + c * (2.0 * dv - dc) : 2.0 * v * dv;
    const double carrier = frame->rotating ? c : v, moved = frame->rotating ? dc : dv;
    const struct vector own = steady_sideband(steady, k);
    memset(right, 0, sizeof *right);
    take(change->stiffness, false, &own, right);
    for (int side = -1; side <= 1; side += 2) {
        const struct vector other = steady_sideband(steady, k + side);
        take(change->pump, true, &other, right);
    }
    for (int i = 0; i < MODES; ++i) {
        const struct precise factor = {
            real_of(square),
            real_negate(real_add(real_multiply(real_of(moved), m->damping[i]),
                                 real_multiply(real_of(carrier), change->damping[i]))),
        };
        right->x[i] = precise_add(right->x[i],
                                  precise_multiply(factor, precise_of_complex(own.x[i])));
        if (k == 0)
            right->x[i].re = real_add(right->x[i].re, change->g[i]);
    }
}

bool steady_tangent(const struct matrices *m, const struct frame *frame,
                    const struct steady_change *change, const struct steady *steady,
                    double tolerance, struct chain *chain, struct vector dx[3])
{
    halve_pump(m, chain);
    if (!eliminated(m, frame, steady, chain))
        return false;
    for (int k = -steady->below; k <= steady->above; ++k) {
        struct block *block = block_of(chain, k);
        change_block(m, frame, change, steady, k, &block->right);
        block->rest = precise_vector_rounded(&block->right);
    }
    solve_in_doubles(steady, chain);
    for (int k = -steady->below; k <= steady->above; ++k) {
        struct block *block = block_of(chain, k);
        for (int i = 0; i < MODES; ++i)
            block->found.x[i] = precise_of_complex(block->rest.x[i]);
    }
    if (tolerance <= LEAST_TOLERANCE && !corrected(m, frame, steady, chain))
        return false;
    memset(dx, 0, 3 * sizeof *dx);
    for (int k = -1; k <= 1; ++k)
        if (-steady->below <= k && k <= steady->above)
            dx[1 + k] = precise_vector_rounded(&block_of(chain, k)->found);
    return true;
}
