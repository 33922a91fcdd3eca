/* The FMU CoupledOscillator: two hybridised modes under a two-tone drive. */
#include "coupled_oscillator.h"

#include <string.h>

#include "two_mode_slave.h"

enum { QUADRATURES = 8 };

/* Refuse numbers of solvers that there are not. */
static bool check_choice(const double *values, struct report *report)
{
    const int solver = (int)values[V_solver], other = (int)values[V_other_mode];
    if (solver < EXACT || solver > RK4)
        return refuse(report, "solver = %d: 0 (exact), 1 (envelope) or 2 (rk4) is wanted", solver);
    if (!check_substep(values[V_rk4_substep], report))
        return false;
    if (other < FULL || other > LEFT_OUT)
        return refuse(report,
                      "other_mode = %d: 0 (full), 1 (quasi-static) or 2 (left out) is wanted",
                      other);
    return true;
}

/* Make the solver that the values ask for, not yet started. */
static bool prepare(struct motion *motion, const double *values, const struct parameters *p,
                    const double offsets[2], struct report *report)
{
    const int solver = (int)values[V_solver], other = (int)values[V_other_mode];
    if (!check_choice(values, report))
        return false;
    if (solver == EXACT && other != FULL) {
        motion->method = SINGLE;
        return single_prepare(&motion->single, p, other, offsets, report);
    }
    if (solver == RK4) {
        motion->method = RUNGE_KUTTA;
        rk4_prepare(&motion->rk4, p, values[V_rk4_substep], offsets);
        return true;
    }
    motion->method = LINEAR;
    return linear_prepare(&motion->linear, p, solver == ENVELOPE, offsets, report);
}

static bool start(struct motion *motion, double t, const struct state *state, double b,
                  struct report *report)
{
    switch (motion->method) {
    case SINGLE:
        return single_start(&motion->single, t, state, b, report);
    case RUNGE_KUTTA:
        return rk4_start(&motion->rk4, t, state, b, report);
    default:
        return linear_start(&motion->linear, t, state, b, report);
    }
}

bool model_begin(struct slave *slave, double t, struct report *report)
{
    static const double no_offsets[2] = {0.0, 0.0};
    const struct parameters p = parameters_of(slave);
    const bool periodic = slave->values[V_periodic_start] != 0.0;
    struct state at_rest;
    memset(&at_rest, 0, sizeof at_rest);
    slave->motion.since = 0.0;
    return check_parameters(&p, periodic, report) &&
           prepare(&slave->motion, slave->values, &p, no_offsets, report) &&
           start(&slave->motion, t, periodic ? NULL : &at_rest, slave->values[V_b], report);
}

/* What all solvers have, under one name. */
static const struct parameters *present_parameters(const struct motion *motion)
{
    switch (motion->method) {
    case SINGLE:
        return &motion->single.p;
    case RUNGE_KUTTA:
        return &motion->rk4.p;
    default:
        return &motion->linear.p;
    }
}

static const double *present_offsets(const struct motion *motion)
{
    switch (motion->method) {
    case SINGLE:
        return motion->single.offsets;
    case RUNGE_KUTTA:
        return motion->rk4.offsets;
    default:
        return motion->linear.offsets;
    }
}

static double present_input(const struct motion *motion)
{
    switch (motion->method) {
    case SINGLE:
        return motion->single.b;
    case RUNGE_KUTTA:
        return motion->rk4.b;
    default:
        return motion->linear.b;
    }
}

/* State and phases are kept; solver and other_mode are fixed, so the method stays. */
bool model_change(struct slave *slave, double t, struct report *report)
{
    const struct parameters p = parameters_of(slave);
    const struct parameters before = *present_parameters(&slave->motion);
    const double *offsets = present_offsets(&slave->motion);
    const double kept[2] = {kept_phase(offsets[0], before.u1, p.u1, t),
                            kept_phase(offsets[1], before.u2, p.u2, t)};
    const double b = present_input(&slave->motion);
    struct state state;
    if (!check_parameters(&p, false, report))
        return false;
    slave->motion.since = t;
    if (slave->motion.method == RUNGE_KUTTA) {
        const struct rk4_solver old = slave->motion.rk4;
        rk4_prepare(&slave->motion.rk4, &p, old.requested, kept);
        rk4_take_over(&slave->motion.rk4, &old);
        return true;
    }
    state = slave->motion.method == SINGLE ? single_state(&slave->motion.single, t)
                                           : linear_state(&slave->motion.linear, t);
    return prepare(&slave->motion, slave->values, &p, kept, report) &&
           start(&slave->motion, t, &state, b, report);
}

static bool grows(const struct motion *motion)
{
    if (motion->method == RUNGE_KUTTA)
        return true; /* a long substep diverges whatever the damping */
    return motion->method == SINGLE ? single_grows(&motion->single)
                                    : linear_grows(&motion->linear);
}

static void displacement(const struct motion *motion, double t, double q[2])
{
    if (motion->method == SINGLE) {
        single_displacement(&motion->single, t, q);
    } else if (motion->method == LINEAR) {
        linear_displacement(&motion->linear, t, q);
    } else {
        q[0] = motion->rk4.at.y[0];
        q[1] = motion->rk4.at.y[1];
    }
}

/* Hold another input from t on. */
static bool with_input(struct motion *motion, double b, double t, struct report *report)
{
    struct state state;
    if (!isfinite(b))
        return refuse(report, "b = %r m/s2 is not a finite number", b);
    motion->since = t;
    if (motion->method == RUNGE_KUTTA) {
        motion->rk4.b = b;
        return true;
    }
    state = motion->method == SINGLE ? single_state(&motion->single, t)
                                     : linear_state(&motion->linear, t);
    return start(motion, t, &state, b, report);
}

bool model_step(struct slave *slave, double t, double end, struct report *report)
{
    struct motion *motion = &slave->motion;
    const double b = slave->values[V_b];
    double q[2];
    if (b != present_input(motion) && !with_input(motion, b, t, report))
        return false;
    if (motion->method == RUNGE_KUTTA && !rk4_advance(&motion->rk4, end, report))
        return false;
    if (!grows(motion))
        return true;
    displacement(motion, end, q);
    if (!isfinite(q[0] + q[1]))
        return refuse(report, "the growing oscillation left the range of numbers before %r s", end);
    return true;
}

bool model_moving(struct slave *slave, double *outputs, struct report *report)
{
    (void)report;
    displacement(&slave->motion, slave->time, outputs);
    physical_displacements(present_parameters(&slave->motion), outputs, outputs + 2);
    return true;
}

/* --- outputs that depend on the parameters only ------------------------------------------------ */

static bool response(const struct motion *motion, double u, struct pair *x, struct report *report)
{
    if (motion->method == SINGLE)
        return single_response(&motion->single, u, x, report);
    if (motion->method == LINEAR)
        return linear_response(&motion->linear, u, x, report);
    return phasors(&motion->rk4.p, u, x, report);
}

/* |X - X_full|/|X_full|, which bounds the relative error of the amplitude; 1 where one of them is
 * 0 only. */
static double left_out(struct complex found, struct complex full)
{
    if (found.re == full.re && found.im == full.im)
        return 0.0;
    return c_is_zero(full) ? 1.0 : c_abs(c_subtract(found, full)) / c_abs(full);
}

/* Quadratures mode by mode and tone by tone, then the errors of both modes. */
static bool write_quadratures(const struct motion *motion, double *outputs, struct report *report)
{
    const struct parameters *p = present_parameters(motion);
    const double u[] = {p->u1, p->u2}, size[] = {p->A1, p->A2}, phase[] = {p->phase1, p->phase2};
    const bool judged = motion->method != RUNGE_KUTTA && (p->g1 != 0.0 || p->g2 != 0.0);
    double *errors = outputs + QUADRATURES;
    memset(outputs, 0, (QUADRATURES + 2) * sizeof *outputs);
    for (int tone = 0; tone < 2; ++tone) {
        const struct complex amplitude = c_rect(size[tone], phase[tone]);
        struct pair found, full;
        if (size[tone] == 0.0)
            continue;
        if (!response(motion, u[tone], &found, report) ||
            (judged && !phasors(p, u[tone], &full, report)))
            return false;
        for (int mode = 0; mode < 2; ++mode) {
            const struct complex seen = c_multiply(found.z[mode], amplitude);
            outputs[4 * mode + 2 * tone] = seen.re;
            outputs[4 * mode + 2 * tone + 1] = seen.im;
            if (judged)
                errors[mode] = fmax(errors[mode], left_out(found.z[mode], full.z[mode]));
        }
    }
    return true;
}

bool model_steady(struct slave *slave, double *outputs, struct report *report)
{
    const struct parameters *p = present_parameters(&slave->motion);
    if (!write_quadratures(&slave->motion, outputs, report))
        return false;
    write_derived(p, outputs + QUADRATURES + 2, report);
    return true;
}

/* --- directional derivatives -------------------------------------------------------------------- */

static struct real product(double a, double b)
{
    return real_multiply(real_of(a), real_of(b));
}

/* The equations, and (seed) what a change of the variables makes of them. All digits of the damping
 * matrix are kept, so that a small coefficient counts beside a large one. */
static struct linear_system system_of(const struct parameters *p, const double *seed)
{
    const double c = cos(p->theta), s = sin(p->theta), sign = p->reflection ? -1.0 : 1.0;
    const double eta[] = {p->eta_plus, p->eta_minus};
    const double angle = seed ? seed[V_theta] : 0.0;
    const double d1 = seed ? seed[V_d1] : p->d1, d2 = seed ? seed[V_d2] : p->d2;
    const struct real cc = product(c, c), ss = product(s, s), cs = product(c, s);
    const struct real apart = real_subtract(real_of(d1), real_of(d2));
    const struct real turned =
        real_multiply(real_subtract(real_of(p->d1), real_of(p->d2)), real_of(angle));
    const struct real across = real_multiply(real_scale(cs, 1), turned);
    struct linear_system system;
    struct real off;
    memset(&system, 0, sizeof system);
    system.modes = 2;
    for (int i = 0; i < 2; ++i)
        system.stiffness[3 * i] =
            product(seed ? 2.0 * eta[i] : eta[i], seed ? seed[V_eta_plus + i] : eta[i]);
    system.damping[0] = real_subtract(
        real_add(real_multiply(cc, real_of(d1)), real_multiply(ss, real_of(d2))), across);
    system.damping[3] = real_add(
        real_add(real_multiply(ss, real_of(d1)), real_multiply(cc, real_of(d2))), across);
    off = real_add(real_multiply(cs, apart), real_multiply(real_subtract(cc, ss), turned));
    system.damping[1] = system.damping[2] = real_multiply(real_of(sign), off);
    return system;
}

static void add_drive(const struct slave *slave, const double *seed, struct linear_system *system)
{
    const double *v = seed ? seed : slave->values;
    const struct motion *motion = &slave->motion;
    const double *values = slave->values;
    int active = 0;
    for (int i = 0; i < 2; ++i) {
        system->g[i] = real_of(v[V_g1 + i]);
        system->u[i] = v[V_u1 + i];
        system->size[i] = v[V_A1 + i];
        system->phase[i] = v[V_phase1 + i];
    }
    system->b = v[V_b];
    system->rotating = motion->method == LINEAR && motion->linear.envelope;
    for (int i = 0; i < 2; ++i)
        if (values[V_A1 + i] != 0.0) {
            system->centre += v[V_u1 + i];
            ++active;
        }
    if (active == 0)
        system->centre = v[V_eta_plus] + v[V_eta_minus];
    system->centre /= active == 1 ? 1.0 : 2.0;
}

static double cycles_at(const struct slave *slave, int tone, double t)
{
    const struct frequency u = frequency_of(slave->values[V_u1 + tone], 0.0);
    return frequency_cycles(&u, t, 0.0) + present_offsets(&slave->motion)[tone];
}

/* Of the displacements; NAN where the solver is no exponential of the equations. */
static void write_moving(struct slave *slave, const struct linear_system *system,
                         const struct linear_system *change, double angle, double *outputs)
{
    const struct linear_solver *linear = &slave->motion.linear;
    const struct parameters *p = present_parameters(&slave->motion);
    const double now[] = {cycles_at(slave, 0, slave->time), cycles_at(slave, 1, slave->time)};
    const double c = angle * cos(p->theta), s = angle * sin(p->theta);
    const double m = p->reflection ? -1.0 : 1.0;
    struct stretch stretch;
    double q[2];
    for (int i = 0; i < 4; ++i)
        outputs[i] = NAN;
    if (slave->motion.method != LINEAR)
        return;
    memset(&stretch, 0, sizeof stretch);
    stretch.in_motion = linear->in_motion;
    stretch.begin = linear->anchor;
    stretch.since = slave->motion.since;
    for (int i = 0; i < 2; ++i) {
        const struct complex z = linear->state.z[i];
        stretch.state[i] = real_of(z.re);
        stretch.state[2 + i] = real_of(linear->envelope ? z.im : linear->state.z[2 + i].re);
        stretch.cycles[i] = cycles_at(slave, i, linear->anchor);
    }
    if (!displacement_tangent(system, change, &stretch, slave->time, now,
                              &slave->scratch.room, outputs))
        return;
    physical_displacements(p, outputs, outputs + 2);
    linear_displacement(linear, slave->time, q);
    outputs[2] += -m * s * q[0] + c * q[1];
    outputs[3] += -m * c * q[0] - s * q[1];
}

/* Of the closed forms, in the order of write_derived. */
static void write_derived_changes(const struct parameters *p, const double *seed, double *outputs)
{
    const struct linear_system change = system_of(p, seed);
    const struct coupling found = coupling_of(p);
    const struct damping w = damping_of(p);
    const double plus = p->eta_plus, minus = p->eta_minus;
    const double squares = (minus - plus) * (minus + plus);
    const double more_plus = 2.0 * plus * seed[V_eta_plus];
    const double more_minus = 2.0 * minus * seed[V_eta_minus];
    const double c = cos(p->theta), s = sin(p->theta), angle = seed[V_theta];
    const double across = 2.0 * c * s * squares * angle;
    const double d11 = real_double(change.damping[0]), d22 = real_double(change.damping[3]);
    const double lambda = -cos(2.0 * p->theta) * squares * angle -
                          0.5 * sin(2.0 * p->theta) * (more_minus - more_plus);
    const double changes[DERIVED_COUNT] = {
        lambda / (2.0 * found.lambda),
        (c * c * more_plus + s * s * more_minus + across) / (2.0 * found.f1),
        (s * s * more_plus + c * c * more_minus - across) / (2.0 * found.f2),
        TWO_PI * d11,
        TWO_PI * d22,
        TWO_PI * real_double(change.damping[1]),
        d11,
        d22,
        w.w11 > 0.0 ? (seed[V_eta_plus] - plus * d11 / w.w11) / w.w11 : NAN,
        w.w22 > 0.0 ? (seed[V_eta_minus] - minus * d22 / w.w22) / w.w22 : NAN,
    };
    memcpy(outputs, changes, sizeof changes);
}

bool model_derivative(struct slave *slave, const double *seed, double *moving, double *steady,
                      struct report *report)
{
    const struct motion *motion = &slave->motion;
    const struct parameters *p = present_parameters(motion);
    struct linear_system system = system_of(p, NULL), change = system_of(p, seed);
    (void)report;
    add_drive(slave, NULL, &system);
    add_drive(slave, seed, &change);
    write_moving(slave, &system, &change, seed[V_theta], moving);
    for (int i = 0; i < QUADRATURES; ++i)
        steady[i] = NAN;
    for (int tone = 0; tone < 2 && motion->method != SINGLE; ++tone) {
        struct complex dz[MOST_MODES];
        if (!phasor_tangent(&system, &change, tone, dz))
            continue;
        for (int mode = 0; mode < 2; ++mode) {
            steady[4 * mode + 2 * tone] = dz[mode].re;
            steady[4 * mode + 2 * tone + 1] = dz[mode].im;
        }
    }
    /* the errors are 0 where nothing is left out */
    steady[QUADRATURES] = steady[QUADRATURES + 1] =
        motion->method == SINGLE || system.rotating ? NAN : 0.0;
    write_derived_changes(p, seed, steady + QUADRATURES + 2);
    return true;
}
