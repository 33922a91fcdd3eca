/* The FMU DuffingOscillator: the two modes of CoupledOscillator with cubic terms. */
#include "duffing_oscillator.h"

#include <string.h>

#include "two_mode_slave.h"

#define LEAST_TOLERANCE 1e-13
#define MOST_TOLERANCE 0.1

static const struct parameters *present_parameters(const struct motion *motion)
{
    return motion->solver == RK4 ? &motion->rk4.p : &motion->envelope.model.p;
}

static struct cubic present_cubic(const struct motion *motion)
{
    const struct rk4_solver *rk4 = &motion->rk4;
    const struct cubic cubic = {rk4->alpha1, rk4->alpha2, rk4->kappa};
    return motion->solver == RK4 ? cubic : motion->envelope.model.cubic;
}

/* Read what solvers are made of; refuse numbers that they do not take. */
static bool read_settings(const double *values, struct envelope_settings *settings,
                          struct report *report)
{
    const int solver = (int)values[V_solver], branch = (int)values[V_branch];
    const double tolerance = values[V_tolerance];
    if (solver != ENVELOPE && solver != RK4)
        return refuse(report, "solver = %d: 1 (envelope) or 2 (rk4) is wanted", solver);
    if (branch != LOWER && branch != UPPER)
        return refuse(report, "branch = %d: 0 (lower) or 1 (upper) is wanted", branch);
    if (!(LEAST_TOLERANCE <= tolerance && tolerance <= MOST_TOLERANCE))
        return refuse(report, "tolerance = %r: %r to %r is wanted", tolerance, LEAST_TOLERANCE,
                      MOST_TOLERANCE);
    if (!check_substep(values[V_rk4_substep], report))
        return false;
    settings->cubic.alpha1 = values[V_alpha1];
    settings->cubic.alpha2 = values[V_alpha2];
    settings->cubic.kappa = values[V_kappa];
    settings->tolerance = tolerance;
    settings->upper = branch == UPPER;
    return check_cubic(&settings->cubic, report);
}

static void set_cubic(struct rk4_solver *solver, const struct cubic *cubic)
{
    solver->alpha1 = cubic->alpha1;
    solver->alpha2 = cubic->alpha2;
    solver->kappa = cubic->kappa;
}

/* --- the periodic start of rk4 ----------------------------------------------------------------- */

/* A point that a period of the drive leads back to. */
struct drive_period {
    const struct rk4_solver *solver;
    double t, u;
};

static bool drift(const void *context, const double x[UNKNOWNS], double value[UNKNOWNS],
                  struct report *report)
{
    const struct drive_period *period = context;
    const double speed = TWO_PI * period->u;
    struct rk4_solver solver = *period->solver;
    solver.t = period->t;
    for (int i = 0; i < UNKNOWNS; ++i)
        solver.at.y[i] = (i < 2 ? 1.0 : speed) * x[i];
    if (!rk4_advance(&solver, period->t + 1.0 / period->u, report))
        return false;
    for (int i = 0; i < UNKNOWNS; ++i)
        value[i] = (i < 2 ? solver.at.y[i] : solver.at.y[i] / speed) - x[i];
    return true;
}

/* Close an orbit over one period of these very substeps, where there is one near. */
static bool close_orbit(const struct drive_period *period, struct state *state, struct report *report)
{
    struct root_problem problem = {.function = drift, .context = period};
    double x[UNKNOWNS], size[2];
    bool found;
    for (int i = 0; i < UNKNOWNS; ++i)
        x[i] = i < 2 ? state->z[i].re : state->z[i].re / period->u;
    for (int i = 0; i < 2; ++i)
        size[i] = fabs(x[i]) + fabs(x[i + 2]);
    for (int i = 0; i < UNKNOWNS; ++i)
        problem.scales[i] = fmax(size[i % 2], 1e-9 * fmax(size[0], size[1]));
    if (!find_root(&problem, x, &found, report))
        return false;
    for (int i = 0; i < UNKNOWNS && found; ++i)
        state->z[i].re = i < 2 ? x[i] : x[i] * period->u;
    return true;
}

/* The envelope's orbit, to its error; for one drive frequency closed by Newton's method. */
static bool start_rk4_on_orbit(struct rk4_solver *solver, const struct envelope_settings *settings,
                               double t, double b, struct report *report)
{
    struct drive_period period = {solver, t, solver->tone[0].frequency.high};
    const bool one = solver->tones == 1 ||
                     (solver->tones == 2 && period.u == solver->tone[1].frequency.high);
    struct envelope_solver envelope;
    struct state state;
    if (b != 0.0)
        return refuse(report,
                      "b = %r: a periodic start with cubic terms is known for b = 0 only; set "
                      "periodic_start to false",
                      b);
    if (!envelope_prepare(&envelope, &solver->p, settings, solver->offsets, report) ||
        !envelope_start(&envelope, t, NULL, b, report))
        return false;
    state = envelope_state(&envelope, t);
    if (one && !close_orbit(&period, &state, report))
        return false;
    return rk4_start(solver, t, &state, b, report);
}

/* --- the course of a run ----------------------------------------------------------------------- */

bool model_begin(struct slave *slave, double t, struct report *report)
{
    static const double no_offsets[2] = {0.0, 0.0};
    const struct parameters p = parameters_of(slave);
    const double b = slave->values[V_b];
    const bool periodic = slave->values[V_periodic_start] != 0.0;
    struct motion *motion = &slave->motion;
    struct envelope_settings settings;
    struct state at_rest;
    memset(&at_rest, 0, sizeof at_rest);
    if (!check_parameters(&p, periodic, report) ||
        !read_settings(slave->values, &settings, report))
        return false;
    motion->solver = (int32_t)slave->values[V_solver];
    if (motion->solver == ENVELOPE) {
        if (!envelope_prepare(&motion->envelope, &p, &settings, no_offsets, report) ||
            !envelope_start(&motion->envelope, t, periodic ? NULL : &at_rest, b, report))
            return false;
    } else {
        rk4_prepare(&motion->rk4, &p, slave->values[V_rk4_substep], no_offsets);
        set_cubic(&motion->rk4, &settings.cubic);
        if (!(periodic && any_cubic(&settings.cubic)
                  ? start_rk4_on_orbit(&motion->rk4, &settings, t, b, report)
                  : rk4_start(&motion->rk4, t, periodic ? NULL : &at_rest, b, report)))
            return false;
    }
    if (settings.upper && !periodic)
        warn(report, "branch = 1 does not apply to a start at rest; set periodic_start to true");
    return true;
}

/* State and phases are kept; the solver is fixed. */
bool model_change(struct slave *slave, double t, struct report *report)
{
    struct motion *motion = &slave->motion;
    const struct parameters p = parameters_of(slave), before = *present_parameters(motion);
    const double *offsets =
        motion->solver == RK4 ? motion->rk4.offsets : motion->envelope.offsets;
    const double kept[2] = {kept_phase(offsets[0], before.u1, p.u1, t),
                            kept_phase(offsets[1], before.u2, p.u2, t)};
    struct envelope_settings settings;
    struct state state;
    if (!check_parameters(&p, false, report) || !read_settings(slave->values, &settings, report))
        return false;
    if (motion->solver == RK4) {
        const struct rk4_solver old = motion->rk4;
        rk4_prepare(&motion->rk4, &p, old.requested, kept);
        set_cubic(&motion->rk4, &settings.cubic);
        rk4_take_over(&motion->rk4, &old);
        return true;
    }
    state = envelope_state(&motion->envelope, t);
    return envelope_prepare(&motion->envelope, &p, &settings, kept, report) &&
           envelope_start(&motion->envelope, t, &state, 0.0, report);
}

static void displacement(const struct motion *motion, double t, double q[2])
{
    if (motion->solver == RK4) {
        q[0] = motion->rk4.at.y[0];
        q[1] = motion->rk4.at.y[1];
    } else {
        slow_displacement(&motion->envelope.model, envelope_amplitudes(&motion->envelope, t), t, q);
    }
}

bool model_step(struct slave *slave, double t, double end, struct report *report)
{
    struct motion *motion = &slave->motion;
    const double b = slave->values[V_b];
    (void)t;
    if (b != (motion->solver == RK4 ? motion->rk4.b : 0.0)) {
        if (!isfinite(b))
            return refuse(report, "b = %r m/s2 is not a finite number", b);
        if (motion->solver == ENVELOPE)
            return envelope_refuse_input(b, report);
        motion->rk4.b = b;
    }
    if (motion->solver == ENVELOPE) /* growth leaves the range of the averaging and is refused there */
        return envelope_advance(&motion->envelope, end, report);
    if (!rk4_advance(&motion->rk4, end, report))
        return false;
    if (!isfinite(motion->rk4.at.y[0] + motion->rk4.at.y[1]))
        return refuse(report, "the growing oscillation left the range of numbers before %r s", end);
    return true;
}

/* The squared amplitudes of both modes, in m^2. */
static void squares_of(const struct motion *motion, double t, double squares[2])
{
    const double omega = TWO_PI * frame_frequency(present_parameters(motion));
    struct pair q = {{{0.0, 0.0}, {0.0, 0.0}}};
    if (motion->solver == ENVELOPE)
        q = envelope_amplitudes(&motion->envelope, t);
    for (int i = 0; i < 2; ++i) {
        const double *y = motion->rk4.at.y, size = c_abs(q.z[i]);
        if (motion->solver == ENVELOPE) {
            squares[i] = size * size;
        } else {
            const double turned = y[2 + i] / omega;
            squares[i] = y[i] * y[i] + turned * turned;
        }
    }
}

/* Displacements, the shift by the cubic terms, and what averaging them costs. */
bool model_moving(struct slave *slave, double *outputs, struct report *report)
{
    const struct motion *motion = &slave->motion;
    const struct parameters *p = present_parameters(motion);
    const struct cubic cubic = present_cubic(motion);
    const double centre = frame_frequency(p);
    double squares[2], shift;
    (void)report;
    squares_of(motion, slave->time, squares);
    shift = cubic_shift(&cubic, squares, centre);
    displacement(motion, slave->time, outputs);
    physical_displacements(p, outputs, outputs + 2);
    outputs[4] = shift;
    outputs[5] =
        motion->solver == ENVELOPE ? envelope_averaging_error(&motion->envelope, slave->time, shift)
                                   : 0.0;
    return true;
}

bool model_steady(struct slave *slave, double *outputs, struct report *report)
{
    write_derived(present_parameters(&slave->motion), outputs, report);
    return true;
}

bool model_derivative(struct slave *slave, const double *seed, double *moving, double *steady,
                      struct report *report)
{
    (void)slave;
    (void)seed;
    (void)moving;
    (void)steady;
    return refuse(report, "getDirectionalDerivative: this model has no derivatives");
}
