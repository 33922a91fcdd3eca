/* The FMUs CoupledModes1 to CoupledModes9: N coupled modes, with a parametric pump. */
#include "coupled_modes.h"

#include <string.h>

#include "slave.h"
#include "tangent.h"

/* Eigenvalues closer than this part of the largest are one for derivatives. */
#define COINCIDE 1e-10

/* Variables stand in this order, see fmu_src/coupled_modes.py; there may be no pairs. */
enum {
    V_coupling = V_d1 + MODES,
    V_depth_coupling = V_depth_f1 + MODES,
    SEEN = MODES + 1 /* the read-out, and each mode */
};

static struct parameters parameters_of(const struct slave *slave)
{
    const double *v = slave->values;
    struct parameters p;
    memset(&p, 0, sizeof p);
    memcpy(p.modes.f, v + V_f1, sizeof p.modes.f);
    memcpy(p.modes.d, v + V_d1, sizeof p.modes.d);
    memcpy(p.modes.coupling, v + V_coupling, PAIRS * sizeof *v);
    memcpy(p.modes.depth_f, v + V_depth_f1, sizeof p.modes.depth_f);
    memcpy(p.modes.depth_coupling, v + V_depth_coupling, PAIRS * sizeof *v);
    memcpy(p.g, v + V_g1, sizeof p.g);
    memcpy(p.u, v + V_u1, sizeof p.u);
    memcpy(p.size, v + V_A1, sizeof p.size);
    memcpy(p.phase, v + V_phase1, sizeof p.phase);
    memcpy(p.readout, v + V_readout1, sizeof p.readout);
    p.tolerance = v[V_tolerance];
    p.modes.pump_hz = v[V_pump_hz];
    p.pump_phase = v[V_pump_phase];
    return p;
}

static bool check_choice(const double *values, struct report *report)
{
    const int solver = (int)values[V_solver];
    const double substep = values[V_rk4_substep], tolerance = values[V_tolerance];
    if (!(0.0 <= substep && substep < INFINITY))
        return refuse(report, "rk4_substep = %r s: 0 or a positive time is wanted", substep);
    if (solver < EXACT || solver > RK4)
        return refuse(report, "solver = %d: 0 (exact), 1 (envelope) or 2 (rk4) is wanted", solver);
    if (!(LEAST_TOLERANCE <= tolerance && tolerance <= MOST_TOLERANCE))
        return refuse(report, "tolerance = %r: %r to %r is wanted", tolerance, LEAST_TOLERANCE,
                      MOST_TOLERANCE);
    return true;
}

/* Bring the scratch in line with the run, which may have been taken up from elsewhere. */
static bool ready(struct slave *slave, struct report *report)
{
    const struct motion *motion = &slave->motion;
    return scratch_make(&slave->scratch, &motion->run.p, motion->solver == ENVELOPE, report);
}

static bool check_input(double b, struct report *report)
{
    return isfinite(b) || refuse(report, "b = %r m/s2 is not a finite number", b);
}

/* --- the course of a run ------------------------------------------------------------------------- */

static bool rk4_start(struct slave *slave, double t, const struct state *state, double b,
                      struct report *report)
{
    struct motion *motion = &slave->motion;
    struct complex z[STATES];
    motion->run.b = b;
    motion->at.t = t;
    for (int i = 0; i < 2; ++i) /* refused now rather than when it is read */
        if (motion->run.p.size[i] != 0.0 && response_of(&slave->scratch, i, report) == NULL)
            return false;
    if (state == NULL && !orbit_at(&motion->run, &slave->scratch, t, b, z, report))
        return false;
    for (int i = 0; i < MODES; ++i) {
        const int j = MODES + i;
        motion->at.q[i] = state ? real_double(state->y[i]) : z[i].re;
        motion->at.v[i] = TWO_PI * (state ? real_double(state->y[j]) : z[j].re);
    }
    return true;
}

static bool start(struct slave *slave, double t, const struct state *state, double b,
                  struct report *report)
{
    if (slave->motion.solver == RK4)
        return rk4_start(slave, t, state, b, report);
    return run_start(&slave->motion.run, &slave->scratch, t, state, b, report);
}

bool model_begin(struct slave *slave, double t, struct report *report)
{
    const bool periodic = slave->values[V_periodic_start] != 0.0;
    const double b = slave->values[V_b];
    struct motion *motion = &slave->motion;
    struct state at_rest;
    memset(&at_rest, 0, sizeof at_rest);
    memset(motion, 0, sizeof *motion);
    motion->run.p = parameters_of(slave);
    motion->solver = (int32_t)slave->values[V_solver];
    motion->substep = slave->values[V_rk4_substep];
    motion->run.envelope = motion->solver == ENVELOPE;
    return check_parameters(&motion->run.p, periodic, report) && check_input(b, report) &&
           check_choice(slave->values, report) && ready(slave, report) &&
           start(slave, t, periodic ? NULL : &at_rest, b, report);
}

static bool present_state(struct slave *slave, double t, struct state *state,
                          struct report *report)
{
    const struct motion *motion = &slave->motion;
    if (motion->solver != RK4)
        return run_state(&motion->run, &slave->scratch, t, state, report);
    for (int i = 0; i < MODES; ++i) {
        state->y[i] = real_of(motion->at.q[i]);
        state->y[MODES + i] = real_of(motion->at.v[i] / TWO_PI);
    }
    return true;
}

/* State and phases are kept; solver and substep are fixed. */
bool model_change(struct slave *slave, double t, struct report *report)
{
    const struct parameters p = parameters_of(slave);
    struct run *run = &slave->motion.run;
    struct state state;
    if (!check_parameters(&p, false, report) || !ready(slave, report) ||
        !present_state(slave, t, &state, report))
        return false;
    for (int i = 0; i < 2; ++i)
        run->offsets[i] = kept_phase(run->offsets[i], run->p.u[i], p.u[i], t);
    run->offsets[2] =
        kept_phase(run->offsets[2], run->p.modes.pump_hz, p.modes.pump_hz, t);
    run->p = p;
    run->since = t;
    return ready(slave, report) && start(slave, t, &state, run->b, report);
}

static bool displacement(struct slave *slave, double t, double *q, struct report *report)
{
    const struct motion *motion = &slave->motion;
    if (motion->solver != RK4)
        return run_displacement(&motion->run, &slave->scratch, t, q, report);
    memcpy(q, motion->at.q, sizeof motion->at.q);
    return true;
}

/* Move as the solver does, to end. */
static bool advance(struct slave *slave, double end, struct report *report)
{
    struct motion *motion = &slave->motion;
    const struct scratch *scratch = &slave->scratch;
    struct rk4_equations e;
    if (motion->solver != RK4)
        return run_advance(&motion->run, &slave->scratch, end, report);
    e = rk4_equations_of(&motion->run.p, &scratch->matrices, motion->substep, scratch->fastest_hz,
                         motion->run.offsets);
    e.b = motion->run.b;
    return rk4_advance(&e, &motion->at, end, report);
}

static bool hold(struct slave *slave, double b, double t, struct report *report)
{
    struct motion *motion = &slave->motion;
    if (!check_input(b, report))
        return false;
    if (motion->solver != RK4)
        return run_with_input(&motion->run, &slave->scratch, b, t, report);
    motion->run.b = b;
    return true;
}

bool model_step(struct slave *slave, double t, double end, struct report *report)
{
    const struct motion *motion = &slave->motion;
    const double b = slave->values[V_b];
    const bool grows = motion->solver == RK4 || least_of(motion->run.p.modes.d) < 0.0;
    double q[MODES], total = 0.0;
    if (!ready(slave, report) || (b != motion->run.b && !hold(slave, b, t, report)) ||
        !advance(slave, end, report))
        return false;
    if (!grows)
        return true;
    if (!displacement(slave, end, q, report))
        return false;
    for (int i = 0; i < MODES; ++i)
        total += q[i];
    if (!isfinite(total))
        return refuse(report, "the growing oscillation left the range of numbers before %r s", end);
    return true;
}

/* --- outputs ------------------------------------------------------------------------------------- */

static struct complex read_out(const struct slave *slave, const struct vector *x)
{
    struct complex sum = {0.0, 0.0};
    for (int i = 0; i < MODES; ++i)
        sum = c_add(sum, c_scale(slave->values[V_readout1 + i], x->x[i]));
    return sum;
}

/* Read-out, displacements, and the read-out's parts at the tones. */
bool model_moving(struct slave *slave, double *outputs, struct report *report)
{
    const struct run *run = &slave->motion.run;
    double *q = outputs + 1;
    if (!ready(slave, report) || !displacement(slave, slave->time, q, report))
        return false;
    outputs[0] = 0.0;
    for (int i = 0; i < MODES; ++i)
        outputs[0] += slave->values[V_readout1 + i] * q[i];
    for (int i = 0; i < 2; ++i) {
        const struct frequency u = frequency_of(run->p.u[i], 0.0);
        const double turn = TWO_PI * (frequency_cycles(&u, slave->time, 0.0) + run->offsets[i]) +
                            run->p.phase[i];
        const struct steady *found;
        struct vector carrier;
        struct complex seen;
        q[MODES + i] = 0.0;
        if (run->p.size[i] == 0.0)
            continue;
        found = response_of(&slave->scratch, i, report);
        if (found == NULL)
            return false;
        carrier = steady_sideband(found, 0);
        seen = read_out(slave, &carrier);
        seen = complex_of(seen.re / FOUR_PI_SQUARED, seen.im / FOUR_PI_SQUARED);
        q[MODES + i] = c_multiply(seen, c_rect(run->p.size[i], turn)).re;
    }
    return true;
}

/* A sideband of read-out and modes. */
static void see(const struct slave *slave, const struct steady *found, int k,
                struct complex seen[SEEN])
{
    const struct vector x = steady_sideband(found, k);
    seen[0] = read_out(slave, &x);
    memcpy(seen + 1, x.x, sizeof x.x);
}

/* In-phase and quadrature of all, tone by tone, then of the read-out's first sidebands. */
static bool write_quadratures(struct slave *slave, double **next, struct report *report)
{
    const struct parameters *p = &slave->motion.run.p;
    struct complex carrier[2][SEEN], sides[4];
    memset(carrier, 0, sizeof carrier);
    memset(sides, 0, sizeof sides);
    for (int tone = 0; tone < 2; ++tone) {
        const struct complex drive = c_rect(p->size[tone], p->phase[tone]);
        const struct complex amplitude =
            complex_of(drive.re / FOUR_PI_SQUARED, drive.im / FOUR_PI_SQUARED);
        struct complex seen[SEEN];
        const struct steady *found;
        if (p->size[tone] == 0.0)
            continue;
        found = response_of(&slave->scratch, tone, report);
        if (found == NULL)
            return false;
        see(slave, found, 0, seen);
        for (int i = 0; i < SEEN; ++i)
            carrier[tone][i] = c_multiply(amplitude, seen[i]);
        for (int place = 0; place < 2; ++place) {
            const int side = place ? -1 : 1;
            const struct complex turned =
                c_multiply(amplitude, c_rect(1.0, side * p->pump_phase));
            see(slave, found, side, seen);
            sides[2 * tone + place] = c_multiply(turned, seen[0]);
        }
    }
    for (int i = 0; i < SEEN; ++i)
        for (int tone = 0; tone < 2; ++tone) {
            *(*next)++ = carrier[tone][i].re;
            *(*next)++ = carrier[tone][i].im;
        }
    for (int i = 0; i < 4; ++i) {
        *(*next)++ = sides[i].re;
        *(*next)++ = sides[i].im;
    }
    return true;
}

/* What one tone's response leaves out, if it is more than the others' so far. */
static bool left_out(struct slave *slave, int tone, double worst[SEEN], struct report *report)
{
    const bool envelope = slave->motion.solver == ENVELOPE;
    const double reach = norm_of(slave->values + V_readout1, MODES);
    const struct steady *found = response_of(&slave->scratch, tone, report);
    const struct steady *full = full_response_of(&slave->scratch, tone, report);
    struct complex seen[SEEN], truth[SEEN];
    double cut;
    if (found == NULL || full == NULL)
        return false;
    cut = found->bound + (envelope ? full->bound : 0.0);
    see(slave, found, 0, seen);
    see(slave, full, 0, truth);
    for (int i = 0; i < SEEN; ++i) {
        const double error =
            c_abs(c_subtract(seen[i], truth[i])) + cut * (i ? 1.0 : reach);
        if (error != 0.0)
            worst[i] =
                fmax(worst[i], c_is_zero(truth[i]) ? 1.0 : error / c_abs(truth[i]));
    }
    return true;
}

/* The relative errors of read-out and modes, and the sidebands in use, of the active tones. */
static bool write_errors(struct slave *slave, double **next, struct report *report)
{
    const struct parameters *p = &slave->motion.run.p;
    const bool by_pump = pumped(&p->modes);
    double worst[SEEN] = {0.0};
    int most = 0;
    for (int tone = 0; tone < 2; ++tone) {
        const struct steady *found = &slave->scratch.response[tone];
        if (p->size[tone] == 0.0 || !(by_pump || slave->motion.solver == ENVELOPE))
            continue;
        if (!left_out(slave, tone, worst, report))
            return false;
        if (by_pump && found->below > most)
            most = found->below;
        if (by_pump && found->above > most)
            most = found->above;
    }
    for (int i = 0; i < SEEN; ++i)
        *(*next)++ = worst[i];
    *(*next)++ = most;
    return true;
}

bool model_steady(struct slave *slave, double *outputs, struct report *report)
{
    const struct matrices *m = &slave->scratch.matrices;
    double *next = outputs;
    if (!ready(slave, report) || !write_quadratures(slave, &next, report) ||
        !write_errors(slave, &next, report))
        return false;
    memcpy(next, m->eta, sizeof m->eta);
    next += MODES;
    for (int i = 0; i < MODES; ++i, ++next) {
        *next = 0.0;
        for (int k = 0; k < MODES; ++k)
            *next += slave->motion.run.p.modes.d[k] * m->shapes[k][i] * m->shapes[k][i];
    }
    for (int i = 0; i < MODES; ++i, ++next) {
        const double width = next[-MODES];
        *next = width > 0.0 ? m->eta[i] / width : NAN;
    }
    return true;
}

/* --- directional derivatives -------------------------------------------------------------------- */

static struct real product(double a, double b)
{
    return real_multiply(real_of(a), real_of(b));
}

/* C or C_p, or (seed) their change: twice a frequency times its own change, times its depth, and its
 * square times the change of the depth. */
static void write_matrix(const struct slave *slave, const double *seed, bool of_pump,
                         struct real *rows)
{
    const double *v = slave->values;
    int place = 0;
    for (int i = 0; i < MODES; ++i)
        for (int j = i; j < MODES; ++j) {
            const int at = j == i ? V_f1 + i : V_coupling + place;
            const int depth = j == i ? V_depth_f1 + i : V_depth_coupling + place;
            const double size = j == i ? v[at] : -v[at];
            const double factor = of_pump ? v[depth] : 1.0;
            struct real x = product(size, v[at]);
            if (seed != NULL && of_pump)
                x = real_multiply(x, real_of(seed[depth]));
            if (seed != NULL)
                x = real_add(real_multiply(product(2.0 * size, seed[at]), real_of(factor)),
                             of_pump ? x : real_of(0.0));
            else
                x = real_multiply(x, real_of(factor));
            rows[MODES * i + j] = x;
            rows[MODES * j + i] = x;
            place += j != i;
        }
}

/* The equations without their pump, or (seed) what a change of the variables makes of them. */
static struct linear_system system_of(const struct slave *slave, const double *seed)
{
    const double *v = seed ? seed : slave->values;
    struct linear_system system;
    int active = 0;
    memset(&system, 0, sizeof system);
    system.modes = MODES;
    system.rotating = slave->motion.solver == ENVELOPE;
    system.b = v[V_b];
    write_matrix(slave, seed, false, system.stiffness);
    for (int i = 0; i < MODES; ++i) {
        system.damping[(MODES + 1) * i] = real_of(v[V_d1 + i]);
        system.g[i] = real_of(v[V_g1 + i]);
    }
    for (int i = 0; i < 2; ++i) {
        system.u[i] = v[V_u1 + i];
        system.size[i] = v[V_A1 + i];
        system.phase[i] = v[V_phase1 + i];
        if (slave->values[V_A1 + i] != 0.0) {
            system.centre += system.u[i];
            ++active;
        }
    }
    for (int i = 0; i < MODES && active == 0; ++i)
        system.centre += v[V_f1 + i];
    system.centre /= active ? active : MODES;
    return system;
}

static double cycles_at(const struct slave *slave, int tone, double t)
{
    const struct run *run = &slave->motion.run;
    const struct frequency u = frequency_of(run->p.u[tone], 0.0);
    return frequency_cycles(&u, t, 0.0) + run->offsets[tone];
}

/* Of the displacements without a pump, where the solver is an exponential of the equations. */
static bool write_displacements(struct slave *slave, const struct linear_system *system,
                                const struct linear_system *change, double *dq)
{
    const struct run *run = &slave->motion.run;
    const double now[] = {cycles_at(slave, 0, slave->time), cycles_at(slave, 1, slave->time)};
    struct stretch stretch;
    if (slave->motion.solver == RK4 || pumped(&run->p.modes))
        return false;
    memset(&stretch, 0, sizeof stretch);
    stretch.in_motion = run->in_motion;
    stretch.since = run->since;
    if (run->in_motion) {
        stretch.begin = run->exact.begun_at;
        memcpy(stretch.state, run->exact.begun.y, sizeof run->exact.begun.y);
        for (int i = 0; i < 2; ++i)
            stretch.cycles[i] = cycles_at(slave, i, stretch.begin);
    }
    return displacement_tangent(system, change, &stretch, slave->time, now,
                                &slave->scratch.room, dq);
}

/* A number as read out, changed by the numbers and by the weights. */
static struct complex read_change(const struct slave *slave, const double *seed,
                                  const struct complex *x, const struct complex *dx)
{
    struct complex sum = {0.0, 0.0};
    for (int i = 0; i < MODES; ++i) {
        sum = c_add(sum, c_scale(slave->values[V_readout1 + i], dx[i]));
        sum = c_add(sum, c_scale(seed[V_readout1 + i], x[i]));
    }
    return sum;
}

/* A exp(i phase) X/(2 pi)^2 of a tone. */
static bool phasor_of(struct slave *slave, int tone, struct complex z[MODES],
                      struct report *report)
{
    const struct parameters *p = &slave->motion.run.p;
    const struct steady *found;
    struct vector x;
    memset(z, 0, MODES * sizeof *z);
    if (p->size[tone] == 0.0)
        return true;
    found = response_of(&slave->scratch, tone, report);
    if (found == NULL)
        return false;
    x = steady_sideband(found, 0);
    for (int i = 0; i < MODES; ++i)
        z[i] = c_scale(1.0 / FOUR_PI_SQUARED,
                       c_multiply(c_rect(p->size[tone], p->phase[tone]), x.x[i]));
    return true;
}

static bool write_moving(struct slave *slave, const double *seed,
                         const struct linear_system *system, const struct linear_system *change,
                         double *outputs)
{
    double q[MODES], dq[MODES];
    struct complex x[MODES], dx[MODES];
    struct report none = {.warnings = 0};
    if (!write_displacements(slave, system, change, dq) ||
        !displacement(slave, slave->time, q, &none))
        return false;
    for (int i = 0; i < MODES; ++i) {
        x[i] = complex_of(q[i], 0.0);
        dx[i] = complex_of(dq[i], 0.0);
        outputs[1 + i] = dq[i];
    }
    outputs[0] = read_change(slave, seed, x, dx).re;
    return true;
}

/* Of a tone's quadratures, and of the read-out's part at it. */
static bool write_tone(struct slave *slave, const double *seed, int tone,
                       const struct complex dz[MODES], double *moving, double *steady)
{
    const struct complex turn = c_rect(1.0, TWO_PI * cycles_at(slave, tone, slave->time));
    const double turned =
        TWO_PI * seed[V_u1 + tone] * (slave->time - slave->motion.run.since);
    struct complex z[MODES], seen;
    struct report none = {.warnings = 0};
    if (!phasor_of(slave, tone, z, &none))
        return false;
    for (int i = -1; i < MODES; ++i) {
        const struct complex part = i < 0 ? read_change(slave, seed, z, dz) : dz[i];
        steady[4 * (i + 1) + 2 * tone] = part.re;
        steady[4 * (i + 1) + 2 * tone + 1] = part.im;
    }
    seen = c_scale(0.0, z[0]);
    for (int i = 0; i < MODES; ++i)
        seen = c_add(seen, c_scale(slave->values[V_readout1 + i], z[i]));
    seen = c_add(read_change(slave, seed, z, dz), c_multiply(complex_of(0.0, turned), seen));
    moving[1 + MODES + tone] = c_multiply(seen, turn).re;
    return true;
}

/* v_i^T dC v_j of the unpumped modes' shapes. */
static double between(const struct matrices *m, const struct linear_system *change, int i, int j)
{
    double sum = 0.0;
    for (int k = 0; k < MODES; ++k)
        for (int l = 0; l < MODES; ++l)
            sum += m->shapes[k][i] * real_double(change->stiffness[MODES * k + l]) *
                   m->shapes[l][j];
    return sum;
}

/* Of eigenfrequencies, widths and quality factors; widths of modes that coincide turn with any
 * change. */
static void write_unpumped(const struct matrices *m, const struct parameters *p,
                           const struct linear_system *change, double *outputs)
{
    for (int i = 0; i < MODES; ++i) {
        double width = 0.0, still = 0.0;
        outputs[i] = between(m, change, i, i) / (2.0 * m->eta[i]);
        for (int k = 0; k < MODES; ++k) {
            width += real_double(change->damping[(MODES + 1) * k]) * m->shapes[k][i] *
                     m->shapes[k][i];
            still += p->modes.d[k] * m->shapes[k][i] * m->shapes[k][i];
        }
        for (int j = 0; j < MODES; ++j) {
            const double gap = (m->eta[i] - m->eta[j]) * (m->eta[i] + m->eta[j]);
            const double mixed = j == i ? 0.0 : between(m, change, j, i);
            if (mixed == 0.0)
                continue;
            if (fabs(gap) < COINCIDE * m->highest) {
                width = NAN;
                outputs[i] = NAN;
            }
            for (int k = 0; k < MODES; ++k)
                width += 2.0 * p->modes.d[k] * m->shapes[k][i] * m->shapes[k][j] * mixed / gap;
        }
        outputs[MODES + i] = width;
        outputs[2 * MODES + i] =
            still > 0.0 ? (outputs[i] - m->eta[i] * width / still) / still : NAN;
    }
}

/* A exp(i phase)/(2 pi)^2 of a tone, and its change. */
static void amplitude_of(const struct slave *slave, const double *seed, int tone,
                         struct complex *a, struct complex *da)
{
    const struct parameters *p = &slave->motion.run.p;
    const struct complex turn = c_scale(1.0 / FOUR_PI_SQUARED, c_rect(1.0, p->phase[tone]));
    *a = c_scale(p->size[tone], turn);
    *da = c_multiply(complex_of(seed[V_A1 + tone], p->size[tone] * seed[V_phase1 + tone]), turn);
}

static void write_steady_change(const struct slave *slave, const double *seed,
                                const struct linear_system *change, int tone,
                                struct steady_change *steady)
{
    memcpy(steady->stiffness, change->stiffness, sizeof steady->stiffness);
    write_matrix(slave, seed, true, steady->pump);
    for (int i = 0; i < MODES; ++i)
        steady->damping[i] = change->damping[(MODES + 1) * i];
    memcpy(steady->g, change->g, sizeof steady->g);
    steady->centre = change->centre;
    steady->u = change->u[tone];
    steady->pump_hz = seed[V_pump_hz];
}

/* Of a tone's quadratures under the pump, and of the read-out's first sidebands. */
static bool write_pumped_tone(struct slave *slave, const double *seed,
                              const struct linear_system *change, int tone, double *moving,
                              double *steady)
{
    struct scratch *scratch = &slave->scratch;
    struct report none = {.warnings = 0};
    const struct steady *found = response_of(scratch, tone, &none);
    struct complex a, da, dz[MODES];
    struct steady_change by;
    struct vector dx[3], x;
    write_steady_change(slave, seed, change, tone, &by);
    amplitude_of(slave, seed, tone, &a, &da);
    if (found == NULL ||
        !steady_tangent(&scratch->matrices, &scratch->frame, &by, found,
                        slave->motion.run.p.tolerance, &scratch->chain, dx))
        return false;
    for (int place = 0; place < 2; ++place) {
        const int side = place ? -1 : 1;
        const struct complex turn = c_rect(1.0, side * slave->motion.run.p.pump_phase);
        const struct complex turned = complex_of(0.0, side * seed[V_pump_phase]);
        const struct vector seen = steady_sideband(found, side);
        const struct complex read = read_out(slave, &seen);
        struct complex part = c_multiply(a, read_change(slave, seed, seen.x, dx[1 + side].x));
        part = c_add(part, c_multiply(c_add(da, c_multiply(turned, a)), read));
        part = c_multiply(part, turn);
        steady[4 * SEEN + 4 * tone + 2 * place] = part.re;
        steady[4 * SEEN + 4 * tone + 2 * place + 1] = part.im;
    }
    x = steady_sideband(found, 0);
    for (int i = 0; i < MODES; ++i)
        dz[i] = c_add(c_multiply(a, dx[1].x[i]), c_multiply(da, x.x[i]));
    return write_tone(slave, seed, tone, dz, moving, steady);
}

static bool deepens(const double *seed)
{
    bool any = false;
    for (int i = 0; i < MODES; ++i)
        any = any || seed[V_depth_f1 + i] != 0.0;
    for (int i = 0; i < PAIRS; ++i)
        any = any || seed[V_depth_coupling + i] != 0.0;
    return any;
}

/* The first sidebands of the read-out that a pump which is off begins to make: A(v) dX = -dC_p/2 X. */
static void write_first_sidebands(struct slave *slave, const double *seed, int tone,
                                  double *sides)
{
    const struct scratch *scratch = &slave->scratch;
    struct complex z[MODES];
    struct real pump[MODES * MODES];
    struct report none = {.warnings = 0};
    if (!phasor_of(slave, tone, z, &none))
        return;
    write_matrix(slave, seed, true, pump);
    for (int place = 0; place < 2; ++place) {
        const int side = place ? -1 : 1;
        const struct complex turn = c_rect(1.0, side * slave->motion.run.p.pump_phase);
        struct precise_matrix block =
            block_at(&scratch->matrices, &scratch->frame, slave->motion.run.p.u[tone], side);
        struct precise right[MODES];
        struct vector x;
        for (int i = 0; i < MODES; ++i) {
            struct complex sum = {0.0, 0.0};
            for (int j = 0; j < MODES; ++j)
                sum = c_subtract(sum, c_scale(0.5 * real_double(pump[MODES * i + j]), z[j]));
            right[i] = precise_of_complex(c_multiply(sum, turn));
        }
        if (!precise_solve(&block.x[0][0], right, MODES))
            return;
        for (int i = 0; i < MODES; ++i)
            x.x[i] = precise_complex(right[i]);
        sides[2 * place] = read_out(slave, &x).re;
        sides[2 * place + 1] = read_out(slave, &x).im;
    }
}

bool model_derivative(struct slave *slave, const double *seed, double *moving, double *steady,
                      struct report *report)
{
    const struct parameters *p = &slave->motion.run.p;
    const bool by_pump = pumped(&p->modes);
    const struct linear_system system = system_of(slave, NULL), change = system_of(slave, seed);
    double *errors = steady + 4 * SEEN + 8;
    if (!ready(slave, report))
        return false;
    for (int i = 0; i < MOVING_COUNT; ++i)
        moving[i] = NAN;
    for (int i = 0; i < STEADY_COUNT; ++i)
        steady[i] = NAN;
    if (!deepens(seed)) /* of the displacements under a pump there is no closed form */
        write_moving(slave, seed, &system, &change, moving);
    for (int tone = 0; tone < 2; ++tone) {
        struct complex dz[MODES];
        if (by_pump)
            write_pumped_tone(slave, seed, &change, tone, moving, steady);
        else if (phasor_tangent(&system, &change, tone, dz))
            write_tone(slave, seed, tone, dz, moving, steady);
        if (!by_pump)
            write_first_sidebands(slave, seed, tone, steady + 4 * SEEN + 4 * tone);
    }
    for (int i = 0; i <= SEEN && !by_pump && !system.rotating && !deepens(seed); ++i)
        errors[i] = 0.0; /* nothing is left out */
    write_unpumped(&slave->scratch.matrices, p, &change, errors + SEEN + 1);
    return true;
}
