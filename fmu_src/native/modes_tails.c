#include "modes_tails.h"

/* Sidebands beyond the cut for which the recursion is walked, as it is the tightest bound. */
enum { WALKED = 4 };
/* Where a sideband on the other side of 0 is looked for, over the lowest eigenfrequency. */
#define MIRROR 0.38

static double square_at(const struct frame *frame, double v)
{
    return frame->rotating ? frame->centre * (2.0 * v - frame->centre) : v * v;
}

/* The frequency of the k-th sideband. */
static double at(const struct side *side, double k)
{
    return side->u + side->sign * k * side->frame->pump_hz;
}

/* A lower bound of 1/|A^-1|: A's field of values keeps the first two off 0, its distance from a
 * normal matrix the third. */
static double distance_at(const struct side *side, double k)
{
    const struct matrices *m = side->m;
    const struct frame *frame = side->frame;
    const double v = at(side, k), square = square_at(frame, v);
    const double carrier = fabs(frame->rotating ? frame->centre : v);
    const double gap = fmax(square - m->highest, m->lowest - square);
    double between = INFINITY;
    for (int i = 0; i < MODES; ++i)
        between = fmin(between, fabs(m->eta[i] * m->eta[i] - square));
    between -= 1e-12 * m->highest;
    return fmax(fmax(gap, carrier * m->narrowest), between - carrier * m->widest);
}

/* A bound of 1/|A^-1| for all from k outwards if it is twice the pump's norm, else 0. */
static double far_at(const struct side *side, double k)
{
    const struct matrices *m = side->m;
    const double v = at(side, k), square = square_at(side->frame, v);
    const bool rising = !side->frame->rotating || side->sign > 0.0;
    const double gap = rising ? square - m->highest : m->lowest - square;
    const bool outwards = side->frame->rotating || v * side->sign > 0.0;
    return outwards && gap >= 2.0 * m->pump_norm ? gap : 0.0;
}

/* d c_k if the damping of all from k outwards has one sign, else 0. */
static double loss_at(const struct side *side, double k)
{
    const struct frame *frame = side->frame;
    const double carrier =
        frame->rotating ? fabs(frame->centre) : at(side, k) * side->sign;
    return fmax(carrier, 0.0) * side->m->narrowest;
}

/* A bound of |S_k^-1| by damping. */
static double damped(const struct side *side, double k)
{
    const double loss = loss_at(side, k), distance = distance_at(side, k);
    const double part = distance / side->m->pump_norm;
    const double least = fmax(loss, fmin(0.5 * distance, loss * (1.0 + part * part)));
    return least > 0.0 ? 1.0 / least : INFINITY;
}

/* The sum of |X_j|, j > k, over |X_k|, by damping. */
static double together(const struct side *side, double k)
{
    const struct matrices *m = side->m;
    const struct frame *frame = side->frame;
    const double loss = loss_at(side, k + 1.0), wide = 2.0 * m->pump_norm;
    double edge = sqrt(m->highest + wide), near;
    if (frame->rotating) {
        const double square = side->sign > 0.0 ? m->highest + wide : m->lowest - wide;
        edge = 0.5 * (square / frame->centre + frame->centre) * side->sign;
    }
    near = fmax(ceil((edge - at(side, k) * side->sign) / frame->pump_hz), 1.0);
    return loss > 0.0 ? side->half_pump / loss * (sqrt(near) + 0.5) : INFINITY;
}

/* A sideband on the other side of 0. */
static double mirror_of(const struct side *side)
{
    const double e = sqrt(side->m->lowest);
    return floor((MIRROR * e - side->sign * side->u) / side->frame->pump_hz) + 1.0;
}

/* Where it is known at once, a bound of |S_k^-1| and of the sum of |X_j|, j > k, over |X_k|. */
static bool begun_at(const struct side *side, double k, struct tail *tail)
{
    const double p = side->m->pump_norm, far = far_at(side, k);
    double mirror, widest, gap, ratio;
    if (far > 0.0) {
        tail->schur = 2.0 / (far + sqrt((far - p) * (far + p)));
        ratio = side->half_pump * tail->schur;
        tail->rest = ratio / (1.0 - ratio);
        return true;
    }
    if (loss_at(side, k) > 0.0) {
        tail->schur = damped(side, k);
        tail->rest = together(side, k);
        return true;
    }
    if (side->frame->rotating)
        return false;
    mirror = mirror_of(side);
    widest = fmax(fabs(at(side, k)), fabs(at(side, mirror)));
    gap = side->m->lowest - widest * widest;
    if (!(gap >= 2.0 * p && p * p * damped(side, mirror) <= 2.0 * gap))
        return false;
    ratio = p / gap;
    tail->schur = 2.0 / gap;
    tail->rest =
        ratio / (1.0 - ratio) + pow(ratio, mirror - 1.0 - k) * together(side, mirror - 1.0);
    return true;
}

/* From where the recursion is walked to end: where a gap begins below a resonance, or else on the
 * other side of 0; 0 where neither is near. */
static int walked_from(const struct side *side, int end, struct tail *tail)
{
    const double below = sqrt(fmax(side->m->lowest - 2.0 * side->m->pump_norm, 0.0));
    const double places[] = {
        floor((-side->sign * side->u - below) / side->frame->pump_hz) + 1.0,
        mirror_of(side),
    };
    for (int i = 0; i < 2; ++i)
        if (end < places[i] && places[i] <= (double)end + MOST_BOUNDED &&
            begun_at(side, places[i], tail))
            return (int)places[i];
    return 0;
}

/* A bound of |S_k^-1| from that of the next one outwards. */
static double recursion(const struct side *side, int k, double outer)
{
    const double p = side->m->pump_norm;
    const double rest = distance_at(side, k) - 0.25 * p * p * outer;
    const double found = rest > 0.0 ? 1.0 / rest : INFINITY;
    return loss_at(side, k) > 0.0 ? fmin(found, damped(side, k)) : found;
}

struct side side_of(const struct matrices *m, const struct frame *frame, double u, int sign)
{
    const struct side side = {m, frame, u, sign, 0.5 * m->pump_norm};
    return side;
}

int side_guess(const struct side *side, double wanted, int most)
{
    int k = 0;
    double left = 1.0;
    while (left > wanted && k <= most) {
        const double distance = distance_at(side, ++k);
        left = distance > 0.0 ? fmin(1.0, left * side->half_pump / distance) : 1.0;
    }
    return k > 2 ? k - 1 : 1;
}

bool side_tail(const struct side *side, int end, struct tail *tail, struct report *report)
{
    int k = end + 1;
    while (k < end + WALKED && far_at(side, k) == 0.0)
        ++k;
    if (!begun_at(side, k, tail))
        k = walked_from(side, end, tail);
    if (k == 0)
        return refuse(report,
                      "pump_hz = %r Hz is too slow: what more than %d sidebands of a drive at %r Hz "
                      "do cannot be bounded",
                      side->frame->pump_hz, MOST_BOUNDED, side->u);
    for (int inner = k - 1; inner > end; --inner) {
        const double following = recursion(side, inner, tail->schur);
        tail->rest = side->half_pump * tail->schur * (1.0 + tail->rest);
        tail->end = inner;
        if (following == INFINITY)
            return true;
        tail->schur = following;
    }
    tail->end = end;
    tail->rest = side->half_pump * tail->schur * (1.0 + tail->rest);
    return true;
}
