#include "duffing_slow.h"

#include <string.h>

/* The frame turns between these multiples of an eigenfrequency, no tone is further from it than the
 * third part of it, and three times its frequency is further than the fourth from an
 * eigenfrequency. */
#define LOWEST 0.5
#define HIGHEST 2.0
#define SPREAD 0.25
#define THIRD 0.1

double frame_frequency(const struct parameters *p)
{
    const double u[] = {p->u1, p->u2}, size[] = {p->A1, p->A2};
    double total = 0.0;
    int active = 0;
    bool any = false;
    for (int i = 0; i < 2; ++i)
        if (size[i] != 0.0) {
            total += u[i];
            ++active;
            any = any || u[i] != 0.0;
        }
    if (any)
        return total / active;
    return fabs(p->eta_plus - p->u1) <= fabs(p->eta_minus - p->u1) ? p->eta_plus : p->eta_minus;
}

/* Refuse a frame that does not hold the cubic motion. */
static bool check_frame(const struct slow_model *model, struct report *report)
{
    const struct parameters *p = &model->p;
    const double centre = model->centre, low = fmin(p->eta_plus, p->eta_minus);
    const double high = fmax(p->eta_plus, p->eta_minus);
    const double u[] = {p->u1, p->u2}, size[] = {p->A1, p->A2};
    struct sentence why = {""};
    bool apart = false;
    for (int i = 0; i < 2; ++i)
        apart = apart || (size[i] != 0.0 && fabs(u[i] - centre) > SPREAD * centre);
    if (!(LOWEST * low <= centre && centre <= HIGHEST * high))
        say(&why, "the drive is beyond %r to %r times the eigenfrequencies", LOWEST, HIGHEST);
    else if (apart)
        say(&why, "u1 = %r Hz and u2 = %r Hz are too far apart for one rotating frame", p->u1,
            p->u2);
    else if (fabs(3.0 * centre / p->eta_plus - 1.0) < THIRD ||
             fabs(3.0 * centre / p->eta_minus - 1.0) < THIRD)
        say(&why, "the third harmonic of the drive meets an eigenfrequency");
    else
        return true;
    return refuse(report,
                  "%s (the drive's centre %r Hz, eta_plus = %r Hz, eta_minus = %r Hz): use solver 2 "
                  "(rk4)",
                  why.text, centre, p->eta_plus, p->eta_minus);
}

/* (i omega - conj(S))^-1: what the counter-rotating half of a force at a frequency meets. */
static struct matrix mirror_of(const struct slow_model *model, double omega)
{
    const struct matrix s = matrix_conjugate(model->plane.solvent);
    const struct complex turn = complex_of(0.0, omega);
    const struct matrix apart = {c_subtract(turn, s.m11), c_scale(-1.0, s.m12),
                                 c_scale(-1.0, s.m21), c_subtract(turn, s.m22)};
    return matrix_inverse(apart);
}

/* What the counter-rotating half of a force at a frequency does. */
static struct matrix mirrored(const struct slow_model *model, double omega)
{
    const struct matrix m = mirror_of(model, omega);
    const struct pair unit[] = {{{{1.0, 0.0}, {0.0, 0.0}}}, {{{0.0, 0.0}, {1.0, 0.0}}}};
    const struct pair first = matrix_times(&m, plane_turned_gain(&model->plane, unit[0]));
    const struct pair second = matrix_times(&m, plane_turned_gain(&model->plane, unit[1]));
    const struct matrix found = {first.z[0], second.z[0], first.z[1], second.z[1]};
    return found;
}

/* The responses to cubic forces away from the carrier, across the modes as well: a mode that only
 * follows the other one through the damping has no cubic force to speak of, and what the other's
 * does to it is of the order of its shift. */
static void set_corrections(struct slow_model *model)
{
    const struct parameters *p = &model->p;
    const double omega = TWO_PI * model->centre, eta[] = {p->eta_plus, p->eta_minus};
    const struct damping w = damping_of(p);
    const double width[] = {w.w11, w.w22};
    const struct complex cross = complex_of(0.0, 3.0 * omega * TWO_PI * w.w12);
    struct complex own[2];
    model->behind = mirrored(model, omega);
    model->behind3 = mirrored(model, 3.0 * omega);
    for (int i = 0; i < 2; ++i) {
        const double detuning = TWO_PI * (eta[i] - 3.0 * model->centre) * TWO_PI *
                                (eta[i] + 3.0 * model->centre);
        own[i] = complex_of(detuning, 3.0 * omega * TWO_PI * width[i]);
    }
    {
        const struct matrix stiffness = {own[0], cross, cross, own[1]};
        model->third = matrix_inverse(stiffness);
    }
}

static int32_t lone_mode(const struct slow_model *model)
{
    const struct plane *plane = &model->plane;
    const struct cubic *cubic = &model->cubic;
    bool coupled = plane->gain[1] != 0.0 || plane->gain[2] != 0.0 || cubic->kappa != 0.0;
    for (int i = 0; i < 2; ++i)
        coupled = coupled || !c_is_zero(plane->cross[i]) || !c_is_zero(plane->mix[i]);
    if (coupled || (cubic->alpha1 != 0.0) == (cubic->alpha2 != 0.0))
        return -1;
    return cubic->alpha1 == 0.0;
}

static bool prepare_tone(struct slow_model *model, double u, struct complex amplitude,
                         double offset, struct report *report)
{
    const struct parameters *p = &model->p;
    const struct matrix answer = mirror_of(model, TWO_PI * u);
    const struct pair gains = {{{p->g1, 0.0}, {p->g2, 0.0}}};
    struct slow_tone *tone = &model->tone[model->tones++];
    tone->detuning = frequency_of(u - model->centre, 0.0);
    tone->offset = offset;
    if (!phasors(p, u, &tone->response, report))
        return false;
    tone->mirror = matrix_times(&answer, plane_turned_gain(&model->plane, gains));
    for (int i = 0; i < 2; ++i) {
        tone->response.z[i] = c_multiply(tone->response.z[i], amplitude);
        tone->mirror.z[i] = c_multiply(tone->mirror.z[i], amplitude);
    }
    return true;
}

bool slow_prepare(struct slow_model *model, const struct parameters *p, const struct cubic *cubic,
                  const double offsets[2], struct report *report)
{
    const double u[] = {p->u1, p->u2}, size[] = {p->A1, p->A2}, phase[] = {p->phase1, p->phase2};
    memset(model, 0, sizeof *model);
    model->p = *p;
    model->cubic = *cubic;
    model->centre = frame_frequency(p);
    model->carrier = frequency_of(model->centre, 0.0);
    if (p->A1 != 0.0 && p->A2 != 0.0)
        model->spread = fabs(p->u1 - p->u2) / model->centre;
    if (any_cubic(cubic) && !check_frame(model, report))
        return false;
    if (!plane_of(p, model->centre, &model->plane, report))
        return false;
    set_corrections(model);
    model->lone = lone_mode(model);
    for (int i = 0; i < 2; ++i)
        if (size[i] != 0.0 &&
            !prepare_tone(model, u[i], c_rect(size[i], phase[i]), offsets[i], report))
            return false;
    return true;
}

/* --- the slow equations ------------------------------------------------------------------------ */

static struct complex detuned_turn(const struct slow_tone *tone, double t)
{
    return c_rect(1.0, TWO_PI * (frequency_cycles(&tone->detuning, t, 0.0) + tone->offset));
}

struct turns slow_turns(const struct slow_model *model, double t)
{
    struct turns turns = {{{0.0, 0.0}, {0.0, 0.0}}};
    for (int k = 0; k < model->tones; ++k)
        turns.z[k] = detuned_turn(&model->tone[k], t);
    return turns;
}

struct turns slow_onwards(const struct slow_model *model, double h)
{
    struct turns turns = {{{0.0, 0.0}, {0.0, 0.0}}};
    for (int k = 0; k < model->tones; ++k)
        turns.z[k] = c_rect(1.0, TWO_PI * frequency_cycles(&model->tone[k].detuning, h, 0.0));
    return turns;
}

struct pair slow_turned(const struct slow_model *model, const struct turns *turns)
{
    struct pair q = {{{0.0, 0.0}, {0.0, 0.0}}};
    for (int k = 0; k < model->tones; ++k)
        for (int i = 0; i < 2; ++i)
            q.z[i] = c_add(q.z[i], c_multiply(model->tone[k].response.z[i], turns->z[k]));
    return q;
}

struct pair slow_linear(const struct slow_model *model, double t)
{
    const struct turns turns = slow_turns(model, t);
    return slow_turned(model, &turns);
}

/* What the other mode adds to a mode's cubic force, beside kappa/4. */
static struct complex coupled_force(const struct complex q[2], const struct complex r[2])
{
    const struct complex c1 = c_conjugate(q[0]), c2 = c_conjugate(q[1]);
    const struct complex own = c_scale(2.0 * c_multiply(q[1], c2).re, q[0]);
    const struct complex back = c_multiply(c1, c_multiply(q[1], q[1]));
    const struct complex third = c_multiply(c_multiply(c2, c2), r[0]);
    const struct complex other = c_multiply(c_multiply(c_scale(2.0, c1), c2), r[1]);
    return c_add(c_add(c_add(own, back), third), other);
}

/* N3, the cubic forces at three times the carrier, to first order. */
static struct pair third_forces(const struct slow_model *model, struct pair q)
{
    const double alpha[] = {model->cubic.alpha1, model->cubic.alpha2}, kappa = model->cubic.kappa;
    struct pair n;
    for (int i = 0; i < 2; ++i) {
        const struct complex own = c_multiply(q.z[i], q.z[i]);
        const struct complex other = c_multiply(q.z[1 - i], q.z[1 - i]);
        n.z[i] = c_multiply(c_scale(0.25, q.z[i]),
                            c_add(c_scale(alpha[i], own), c_scale(kappa, other)));
    }
    return n;
}

/* N of both modes without what third harmonics do to it. */
static struct pair leading_forces(const struct slow_model *model, struct pair q)
{
    const double alpha[] = {model->cubic.alpha1, model->cubic.alpha2}, kappa = model->cubic.kappa;
    double m[2];
    struct pair n;
    for (int i = 0; i < 2; ++i) {
        m[i] = q.z[i].re * q.z[i].re + q.z[i].im * q.z[i].im;
        n.z[i] = c_scale(0.75 * alpha[i] * m[i], q.z[i]);
    }
    if (kappa != 0.0)
        for (int i = 0; i < 2; ++i) {
            const struct complex other = c_multiply(q.z[1 - i], q.z[1 - i]);
            const struct complex back = c_multiply(c_conjugate(q.z[i]), other);
            const struct complex both = c_add(c_scale(2.0 * m[1 - i], q.z[i]), back);
            n.z[i] = c_add(n.z[i], c_scale(0.25 * kappa, both));
        }
    return n;
}

/* N, the cubic forces at the carrier, of both modes. */
static struct pair forces(const struct slow_model *model, struct pair at)
{
    const double alpha[] = {model->cubic.alpha1, model->cubic.alpha2}, kappa = model->cubic.kappa;
    const struct complex *q = at.z;
    const struct pair third = matrix_times(&model->third, third_forces(model, at));
    const struct complex r[] = {c_scale(-1.0, third.z[0]), c_scale(-1.0, third.z[1])};
    struct pair n;
    for (int i = 0; i < 2; ++i) {
        const struct complex c = c_conjugate(q[i]);
        const struct complex own = c_scale(c_multiply(q[i], c).re, q[i]);
        n.z[i] = c_scale(0.75 * alpha[i], c_add(own, c_multiply(c_multiply(c, c), r[i])));
    }
    if (kappa != 0.0)
        for (int i = 0; i < 2; ++i) {
            const struct complex both[] = {q[i], q[1 - i]}, thirds[] = {r[i], r[1 - i]};
            n.z[i] = c_add(n.z[i], c_scale(0.25 * kappa, coupled_force(both, thirds)));
        }
    return n;
}

static struct pair pair_sum(struct pair a, struct pair b)
{
    const struct pair sum = {{c_add(a.z[0], b.z[0]), c_add(a.z[1], b.z[1])}};
    return sum;
}

static struct pair pair_difference(struct pair a, struct pair b)
{
    const struct pair left = {{c_subtract(a.z[0], b.z[0]), c_subtract(a.z[1], b.z[1])}};
    return left;
}

/* B N: how far the counter-rotating half of the cubic forces moves both modes. */
static struct pair moved(const struct slow_model *model, struct pair q)
{
    return matrix_times(&model->behind, forces(model, q));
}

static struct pair moved_once(const struct slow_model *model, struct pair q)
{
    return pair_difference(q, matrix_times(&model->behind, leading_forces(model, q)));
}

/* Q = Q0 - B N(Q), in two rounds: a mode far below the drive is moved by several times its relative
 * frequency shift. */
struct pair slow_amplitudes(const struct slow_model *model, struct pair w, struct pair linear)
{
    const struct pair first = pair_sum(linear, plane_amplitudes(&model->plane, w));
    return pair_difference(first, moved(model, moved_once(model, first)));
}

struct pair slow_deviation(const struct slow_model *model, struct pair q, struct pair linear)
{
    const struct pair beside = pair_sum(q, moved(model, q));
    return plane_coordinates(&model->plane, pair_difference(beside, linear));
}

void slow_slope(const void *context, const struct pair *w, const struct pair *linear,
                struct pair *n, struct pair *q)
{
    const struct slow_model *model = context;
    const struct plane *plane = &model->plane;
    *q = slow_amplitudes(model, *w, *linear);
    *n = plane_coordinates(plane, plane_turned_gain(plane, forces(model, *q)));
    n->z[0] = c_add(n->z[0], c_multiply(plane->cross[0], w->z[1]));
    n->z[1] = c_add(n->z[1], c_multiply(plane->cross[1], w->z[0]));
}

/* --- what averaging leaves out ------------------------------------------------------------------ */

/* Q' over pi |u1 - u2| of both modes, which turns with two lines of a beat. */
static struct pair pace_of(const struct slow_model *model, struct pair w, struct pair linear,
                           double t)
{
    struct turns turns = slow_turns(model, t);
    const double u[] = {model->p.u1, model->p.u2};
    const double scale = 1.0 / (0.5 * TWO_PI * model->spread * model->centre);
    struct pair n, q, found;
    for (int k = 0; k < 2; ++k) {
        const struct complex speed = complex_of(0.0, TWO_PI * (u[k] - model->centre));
        turns.z[k] = c_multiply(speed, turns.z[k]);
    }
    slow_slope(model, &w, &linear, &n, &q);
    for (int i = 0; i < 2; ++i)
        w.z[i] = c_add(c_multiply(model->plane.rates[i], w.z[i]), n.z[i]);
    found = pair_sum(slow_turned(model, &turns), plane_amplitudes(&model->plane, w));
    for (int i = 0; i < 2; ++i)
        found.z[i] = c_scale(scale, found.z[i]);
    return found;
}

/* |Q|; of two tones the root of the sum of their lines' squares, which is steady. */
static double size_of(const struct slow_model *model, struct complex q, struct complex pace)
{
    return model->spread == 0.0 ? c_abs(q) : hypot(c_abs(q), c_abs(pace)) * sqrt(0.5);
}

/* What each mode takes over of the other one through the damping, at the carrier. */
static void follows(const struct slow_model *model, double eps, double found[2])
{
    const struct parameters *p = &model->p;
    const struct damping w = damping_of(p);
    const double omega = TWO_PI * model->centre, room = 6.0 * eps * omega * omega;
    const double across = omega * TWO_PI * fabs(w.w12);
    const double eta[] = {p->eta_plus, p->eta_minus}, width[] = {w.w11, w.w22};
    for (int i = 0; i < 2; ++i) {
        const double apart =
            fabs(TWO_PI * (eta[i] - model->centre) * TWO_PI * (eta[i] + model->centre));
        const double resists = hypot(fmax(apart - room, 0.0), omega * TWO_PI * width[i]);
        found[i] = 0.0;
        if (across != 0.0)
            found[i] = across < 1e300 * resists ? across / resists : 1e300;
    }
}

double slow_averaging_error(const struct slow_model *model, struct pair w, double t, double eps)
{
    const struct pair linear = slow_linear(model, t), nothing = {{{0.0, 0.0}, {0.0, 0.0}}};
    const struct pair first = pair_sum(linear, plane_amplitudes(&model->plane, w));
    const struct pair last = moved(model, moved_once(model, first));
    const struct pair q = pair_difference(first, last);
    const struct pair after = moved(model, q);
    const struct pair pace = model->spread == 0.0 ? nothing : pace_of(model, w, linear, t);
    const struct transformation r = transformation_of(model->p.theta, model->p.reflection);
    const double sums[][2] = {{1.0, 0.0}, {0.0, 1.0}, {r.t11, r.t21}, {r.t12, r.t22}};
    double lacks[2], follow[2], errors[2], found = 0.0;
    if (eps == 0.0)
        return 0.0;
    for (int i = 0; i < 2; ++i) {
        const double size = size_of(model, q.z[i], pace.z[i]);
        lacks[i] = size * eps * 3.0 * eps +
                   model->spread * fmax(eps * size, 1.5 * c_abs(after.z[i])) +
                   2.0 * c_abs(c_subtract(after.z[i], last.z[i]));
    }
    follows(model, eps, follow);
    for (int i = 0; i < 2; ++i)
        errors[i] = fmax(lacks[i], follow[i] * lacks[1 - i]);
    for (int k = 0; k < 4; ++k) {
        const double *s = sums[k], error = fabs(s[0]) * errors[0] + fabs(s[1]) * errors[1];
        const double size =
            size_of(model, c_add(c_scale(s[0], q.z[0]), c_scale(s[1], q.z[1])),
                    c_add(c_scale(s[0], pace.z[0]), c_scale(s[1], pace.z[1])));
        if (error > 0.0)
            found = fmax(found, error < size ? error / size : 1.0);
    }
    return found;
}

/* --- the full motion --------------------------------------------------------------------------- */

static struct complex carrier_turn(const struct slow_model *model, double t)
{
    return c_rect(1.0, TWO_PI * frequency_cycles(&model->carrier, t, 0.0));
}

void slow_displacement(const struct slow_model *model, struct pair q, double t, double found[2])
{
    const struct complex turn = carrier_turn(model, t);
    const struct complex cube = c_multiply(c_multiply(turn, turn), turn);
    const struct pair r = matrix_times(&model->third, third_forces(model, q));
    for (int i = 0; i < 2; ++i)
        found[i] = c_multiply(q.z[i], turn).re - c_multiply(r.z[i], cube).re;
}

/* Z less y exp(i phi): the linear response and the parts away from the carrier. */
static struct pair beside(const struct slow_model *model, struct pair w, struct pair linear,
                          double t)
{
    const struct complex turn = carrier_turn(model, t);
    const struct complex cube = c_multiply(c_multiply(turn, turn), turn);
    const struct pair y = plane_amplitudes(&model->plane, w);
    const struct pair q = slow_amplitudes(model, w, linear), force3 = third_forces(model, q);
    const struct pair third = matrix_times(&model->third, force3);
    const struct pair mirror3 = matrix_times(&model->behind3, force3);
    struct pair ahead = {{{0.0, 0.0}, {0.0, 0.0}}}, mirror = ahead, total;
    for (int k = 0; k < model->tones; ++k) {
        const struct slow_tone *tone = &model->tone[k];
        const struct complex part = detuned_turn(tone, t);
        for (int i = 0; i < 2; ++i) {
            const struct complex rest = c_subtract(tone->response.z[i], tone->mirror.z[i]);
            mirror.z[i] = c_add(mirror.z[i], c_multiply(tone->mirror.z[i], part));
            ahead.z[i] = c_add(ahead.z[i], c_multiply(rest, part));
        }
    }
    for (int i = 0; i < 2; ++i) {
        const struct complex moved = c_subtract(c_subtract(q.z[i], linear.z[i]), y.z[i]);
        const struct complex behind = c_add(mirror.z[i], moved);
        const struct complex behind3 = c_scale(-1.0, mirror3.z[i]);
        const struct complex ahead3 = c_subtract(c_scale(-1.0, third.z[i]), behind3);
        const struct complex front =
            c_add(c_multiply(ahead.z[i], turn), c_multiply(ahead3, cube));
        const struct complex back = c_add(c_multiply(behind, turn), c_multiply(behind3, cube));
        total.z[i] = c_add(front, c_conjugate(back));
    }
    return total;
}

struct state slow_full_state(const struct slow_model *model, struct pair w, double t)
{
    const struct complex turn = carrier_turn(model, t);
    const struct pair rest = beside(model, w, slow_linear(model, t), t);
    const struct pair y = plane_amplitudes(&model->plane, w);
    struct state state;
    struct pair z, v;
    memset(&state, 0, sizeof state);
    for (int i = 0; i < 2; ++i)
        z.z[i] = c_add(c_multiply(y.z[i], turn), rest.z[i]);
    v = matrix_times(&model->plane.solvent, z);
    for (int i = 0; i < 2; ++i) {
        state.z[i].re = z.z[i].re;
        state.z[2 + i].re = v.z[i].re / TWO_PI;
    }
    return state;
}

/* What lies beside w depends on it through the cubic forces: iterated, it gains the factor of the
 * relative frequency shift each time. */
struct pair slow_from_state(const struct slow_model *model, const struct state *state, double t)
{
    const struct matrix s = matrix_conjugate(model->plane.solvent);
    const struct pair q = {{{state->z[0].re, 0.0}, {state->z[1].re, 0.0}}};
    const struct pair pulled = matrix_times(&s, q), linear = slow_linear(model, t);
    const struct complex back = c_conjugate(carrier_turn(model, t));
    struct pair z, w;
    for (int i = 0; i < 2; ++i)
        z.z[i] = c_subtract(complex_of(TWO_PI * state->z[2 + i].re, 0.0), pulled.z[i]);
    z = plane_turned_gain(&model->plane, z);
    for (int i = 0; i < 2; ++i) {
        z.z[i] = c_scale(-2.0, z.z[i]);
        w.z[i] = c_subtract(c_multiply(z.z[i], back), linear.z[i]);
    }
    w = plane_coordinates(&model->plane, w);
    for (int round = 0; round < 12; ++round) {
        const struct pair rest = beside(model, w, linear, t);
        for (int i = 0; i < 2; ++i)
            w.z[i] = c_multiply(c_subtract(z.z[i], rest.z[i]), back);
        w = plane_coordinates(&model->plane, w);
    }
    return w;
}
