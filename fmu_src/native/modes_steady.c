/* The blocks are eliminated in doubles from both ends to the middle, in the order of
 * fmu_src/modes_steady.py, then corrected with residuals of all digits. */
#include "modes_steady.h"

#include <string.h>

/* Largest part of the largest sideband that cutting the chain may cost, all sidebands together. */
#define WANTED 1e-14

static double square_at(const struct frame *frame, double v)
{
    return frame->rotating ? frame->centre * (2.0 * v - frame->centre) : v * v;
}

struct precise_matrix block_at(const struct matrices *m, const struct frame *frame, double u, int k)
{
    const struct real step = real_multiply(real_of(k), real_of(frame->pump_hz));
    const struct real v = real_add(real_of(u), step), c = real_of(frame->centre);
    const struct real square =
        frame->rotating
            ? real_multiply(c, real_subtract(real_add(v, v), c))
            : real_multiply(v, v);
    const struct real carrier = frame->rotating ? c : v;
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

/* A lower bound of 1/|A^-1|: A's field of values keeps the first two off 0, its distance from a
 * normal matrix the third. */
static double distance_at(const struct matrices *m, const struct frame *frame, double v)
{
    const double square = square_at(frame, v);
    const double carrier = fabs(frame->rotating ? frame->centre : v);
    const double gap = fmax(square - m->highest, m->lowest - square);
    double between = INFINITY;
    for (int i = 0; i < MODES; ++i)
        between = fmin(between, fabs(m->eta[i] * m->eta[i] - square));
    between -= 1e-12 * m->highest;
    return fmax(fmax(gap, carrier * m->narrowest), between - carrier * m->widest);
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

/* --- the bounds of what is beyond the cut ------------------------------------------------------ */

/* A bound of 1/|A| that holds from v outwards, if it is twice the pump's norm; 0 otherwise. */
static double beyond(const struct matrices *m, const struct frame *frame, double v, int sign)
{
    const double square = square_at(frame, v);
    const double gap =
        frame->rotating && sign < 0 ? m->lowest - square : square - m->highest;
    const bool outwards = frame->rotating || v * sign > 0.0;
    return outwards && gap >= 2.0 * m->pump_norm ? gap : 0.0;
}

static bool tail_of(const struct matrices *m, const struct frame *frame, double u, int sign,
                    struct tail *tail, struct report *report)
{
    const double p = m->pump_norm;
    int near = 0;
    double last, s;
    for (;;) {
        const double v = u + sign * (near + 1) * frame->pump_hz;
        last = beyond(m, frame, v, sign);
        if (last > 0.0)
            break;
        if (near == MOST_BOUNDED)
            return refuse(report,
                          "pump_hz = %r Hz is too slow: more than %d sidebands of a drive at %r Hz "
                          "lie below the highest eigenfrequency",
                          frame->pump_hz, MOST_BOUNDED, u);
        tail->s[++near] = distance_at(m, frame, v);
    }
    /* from here on all a_k are smaller: the fixed point of the recursion bounds every s_k */
    s = 2.0 / (last + sqrt((last - p) * (last + p)));
    tail->last = near + 1;
    tail->least = 0;
    tail->half_pump = 0.5 * p;
    tail->s[tail->last] = s;
    for (int k = near; k > 0; --k) {
        const double rest = tail->s[k] - 0.25 * p * p * s;
        if (rest <= 0.0) {
            tail->least = k; /* the chain must reach this far: beyond it every s_k exists */
            break;
        }
        s = 1.0 / rest;
        tail->s[k] = s;
    }
    return true;
}

static double tail_at(const struct tail *tail, int k)
{
    return tail->s[k < tail->last ? k : tail->last];
}

/* Where the sidebands have fallen to the wanted part, by their bounds. */
static int first_guess(const struct tail *tail)
{
    int k = tail->least > 1 ? tail->least : 1;
    double left = 1.0;
    while (left > WANTED && k < MOST_SIDEBANDS)
        left *= fmin(1.0, tail->half_pump * tail_at(tail, ++k));
    return k;
}

/* A bound of the sum of all |X_j|, j > k, over |X_k|. */
static double after(const struct tail *tail, int k)
{
    const int last = tail->last > k + 1 ? tail->last : k + 1;
    double total = 0.0, part = 1.0, ratio;
    for (int j = k + 1; j <= last; ++j) {
        part *= tail->half_pump * tail_at(tail, j);
        total += part;
        if (part < 1e-300)
            return total;
    }
    /* beyond the last one every ratio is at most that of the fixed point, below 1/3 */
    ratio = tail->half_pump * tail->s[tail->last];
    return total + part * ratio / (1.0 - ratio);
}

/* --- the chain -------------------------------------------------------------------------------- */

static void halve_pump(const struct matrices *m, struct chain *chain)
{
    for (int i = 0; i < MODES; ++i)
        for (int j = 0; j < MODES; ++j)
            chain->half_pump.x[i][j] = complex_of(0.5 * m->pump_values[i][j], 0.0);
}

/* A(v_k) + C_p/2 R_j summed over the neighbours j further out, inverted. */
static bool eliminate(const struct matrices *m, const struct frame *frame,
                      const struct steady *steady, int k, struct chain *chain)
{
    const struct precise_matrix exact = block_at(m, frame, steady->u, k);
    struct matrix rows;
    for (int i = 0; i < MODES; ++i)
        for (int j = 0; j < MODES; ++j)
            rows.x[i][j] = precise_complex(exact.x[i][j]);
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
    return matrix_inverse(&rows, &block_of(chain, k)->inverse);
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

/* Solve for the blocks' right sides, corrected until doubles can hold no more. */
static bool solved(const struct matrices *m, const struct frame *frame,
                   const struct steady *steady, struct chain *chain)
{
    double before = INFINITY;
    for (int k = -steady->below; k <= steady->above; ++k)
        memset(&block_of(chain, k)->found, 0, sizeof(struct precise_vector));
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
        if (size <= 1e-19 * largest)
            return true;
        if (!(size < 0.1 * before))
            return false;
        before = size;
    }
}

/* Bounds of one side: |X_last|/|X_0|, the sum of |X_k|/|X_0|, |block (last, last)| of the inverse,
 * and the sum of |blocks (k, last)|. */
struct norms {
    double reach, reaches, own, from_end;
};

static struct norms norms_of(struct chain *chain, int sign, int most)
{
    double ratios[MOST_SIDEBANDS + 1], own[MOST_SIDEBANDS + 1], part = 1.0;
    struct norms norms = {1.0, 0.0, 0.0, 0.0};
    own[0] = matrix_norm(&block_of(chain, 0)->inverse);
    for (int k = 1; k <= most; ++k) {
        const struct block *block = block_of(chain, sign * k);
        ratios[k] = matrix_norm(&block->ratio);
        norms.reach *= ratios[k];
        norms.reaches += norms.reach;
        own[k] = matrix_norm(&block->inverse) + ratios[k] * ratios[k] * own[k - 1];
    }
    norms.own = own[most];
    for (int k = most; k >= 0; --k) {
        norms.from_end += own[k] * part;
        part *= k ? ratios[k] : 1.0;
    }
    return norms;
}

/* What the cut costs at most, over all sidebands; infinite where no bound holds. */
static double bound_of(const struct matrices *m, const struct steady *steady, struct chain *chain)
{
    const double quarter = 0.25 * (m->pump_norm * m->pump_norm);
    const struct norms up = norms_of(chain, 1, steady->above);
    const struct norms down = norms_of(chain, -1, steady->below);
    const double high = quarter * tail_at(&chain->tail[0], steady->above + 1);
    const double low = quarter * tail_at(&chain->tail[1], steady->below + 1);
    const double middle = matrix_norm(&block_of(chain, 0)->inverse);
    const double across = up.reach * middle * down.reach;
    const double feedback =
        fmax(up.own * high + across * low, across * high + down.own * low);
    const double ends = fmax(vector_norm(&steady->sideband[MOST_SIDEBANDS - steady->below]),
                             vector_norm(&steady->sideband[MOST_SIDEBANDS + steady->above]));
    double changed;
    if (feedback >= 0.5)
        return INFINITY;
    changed = high * (up.from_end + down.reaches * middle * up.reach);
    changed += low * (down.from_end + up.reaches * middle * down.reach);
    return ends / (1.0 - feedback) *
           (changed +
            (after(&chain->tail[0], steady->above) + after(&chain->tail[1], steady->below)));
}

/* A unit tone on the gains as the right side. */
static void push(const double *g, const struct steady *steady, struct chain *chain)
{
    for (int k = -steady->below; k <= steady->above; ++k)
        for (int i = 0; i < MODES; ++i)
            block_of(chain, k)->right.x[i] = precise_of(k == 0 ? g[i] : 0.0, 0.0);
}

/* Take over the solution; the norm of the largest sideband. */
static double keep(struct chain *chain, struct steady *steady)
{
    double largest = 0.0;
    steady->carrier = block_of(chain, 0)->found;
    for (int k = -steady->below; k <= steady->above; ++k) {
        struct vector *x = &steady->sideband[MOST_SIDEBANDS + k];
        *x = precise_vector_rounded(&block_of(chain, k)->found);
        largest = fmax(largest, vector_norm(x));
    }
    return largest;
}

/* The response under the pump, from a chain that is long enough. */
static bool pumped_steady(const struct matrices *m, const struct frame *frame, const double *g,
                          struct chain *chain, struct steady *steady, struct report *report)
{
    halve_pump(m, chain);
    if (!tail_of(m, frame, steady->u, 1, &chain->tail[0], report) ||
        !tail_of(m, frame, steady->u, -1, &chain->tail[1], report))
        return false;
    steady->above = first_guess(&chain->tail[0]);
    steady->below = first_guess(&chain->tail[1]);
    for (;;) {
        double largest;
        if (steady->above > MOST_SIDEBANDS || steady->below > MOST_SIDEBANDS)
            return refuse(report,
                          "the pump at pump_hz = %r Hz needs more than %d sidebands of a drive at "
                          "%r Hz: a faster or a weaker pump is wanted",
                          frame->pump_hz, MOST_SIDEBANDS, steady->u);
        push(g, steady, chain);
        if (!eliminated(m, frame, steady, chain) || !solved(m, frame, steady, chain))
            return refuse(report,
                          "the sidebands of the pump at pump_hz = %r Hz cannot be solved for: the "
                          "modes are too close to undamped, or to instability",
                          frame->pump_hz);
        largest = keep(chain, steady);
        steady->bound = bound_of(m, steady, chain);
        if (steady->bound <= WANTED * largest)
            return true;
        steady->above += 1 + steady->above / 4;
        steady->below += 1 + steady->below / 4;
    }
}

bool steady_of(const struct matrices *m, const struct frame *frame, const double *g, double u,
               struct chain *chain, struct steady *steady, struct report *report)
{
    struct precise_matrix block;
    steady->u = u;
    if (m->pump_norm != 0.0)
        return pumped_steady(m, frame, g, chain, steady, report);
    steady->below = steady->above = 0;
    steady->bound = 0.0;
    block = block_at(m, frame, u, 0);
    for (int i = 0; i < MODES; ++i)
        steady->carrier.x[i] = precise_of(g[i], 0.0);
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
                    struct chain *chain, struct vector dx[3])
{
    halve_pump(m, chain);
    for (int k = -steady->below; k <= steady->above; ++k)
        change_block(m, frame, change, steady, k, &block_of(chain, k)->right);
    if (!eliminated(m, frame, steady, chain) || !solved(m, frame, steady, chain))
        return false;
    memset(dx, 0, 3 * sizeof *dx);
    for (int k = -1; k <= 1; ++k)
        if (-steady->below <= k && k <= steady->above)
            dx[1 + k] = precise_vector_rounded(&block_of(chain, k)->found);
    return true;
}
