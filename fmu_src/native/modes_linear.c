/* Without a pump the transient and the turning of the drive are carried in 192 bits, so that the sum
 * of a large orbit and a transient that nearly cancels it, as at the start from rest, keeps the
 * digits of a double. With a pump the transient is a series in doubles. */
#include "modes_linear.h"

#include <string.h>

/* A transient that has fallen to this part of its start is lost beside any number. */
#define DECAYED 1e-43
/* Sidebands below this part of the largest one are left out of the sum. */
#define NO_LINE 1e-19

static bool same(const void *a, const void *b, size_t size)
{
    return memcmp(a, b, size) == 0;
}

/* --- what follows from the parameters ---------------------------------------------------------- */

/* The frequency of the rotating frame: the mean of the active tones, or of the modes. */
static double centre_of(const struct parameters *p)
{
    double total = 0.0;
    int count = 0;
    for (int i = 0; i < 2; ++i)
        if (p->size[i] != 0.0) {
            total += p->u[i];
            ++count;
        }
    for (int i = 0; i < MODES && count == 0; ++i)
        total += p->modes.f[i];
    return total / (count ? count : MODES);
}

static bool make_flow(struct scratch *scratch, struct report *report)
{
    const struct frame *frame = &scratch->frame;
    const double fastest = frame->rotating ? fmax(scratch->fastest_hz, 2.0 * frame->centre)
                                           : scratch->fastest_hz;
    if (scratch->has_flow)
        return true;
    if (!generator_of(&scratch->matrices, frame, &scratch->generator, report))
        return false;
    propagator_make(&scratch->flow, scratch->generator.still, STATES);
    pumped_propagator_make(&scratch->pumped_flow, &scratch->generator, frame->pump_hz, fastest);
    scratch->has_flow = true;
    return true;
}

static void make_table(struct scratch *scratch)
{
    if (!scratch->has_table)
        period_table_make(&scratch->table, &scratch->pumped_flow);
    scratch->has_table = true;
}

/* Refuse where the pumped motion grows, or where that cannot be excluded: of the full equations, as
 * the envelope's pump couples frequencies of one sign alone. */
static bool check_stable(struct scratch *scratch, struct report *report)
{
    const struct matrices *m = &scratch->matrices;
    const double pump_hz = scratch->frame.pump_hz;
    const struct frame kept = scratch->frame;
    double growth;
    if (m->pump_norm == 0.0 || pump_conserves(m, pump_hz))
        return true;
    if (scratch->fastest_hz / pump_hz > MOST_PERIODS)
        return refuse(report,
                      "the pump at pump_hz = %r Hz is too slow and too deep (by %3 of the stiffness) "
                      "for its stability to be shown: less depth is wanted",
                      pump_hz, m->relative_pump);
    scratch->frame.rotating = false;
    if (!make_flow(scratch, report))
        return false;
    make_table(scratch);
    scratch->frame = kept;
    if (kept.rotating) /* the envelope's own are others */
        scratch->has_flow = scratch->has_table = false;
    growth = growth_of(&scratch->table);
    if (growth < 1.0)
        return true;
    return refuse(report,
                  "the pump at pump_hz = %r Hz makes the modes unstable: an oscillation grows by the "
                  "factor %9 per pump period (parametric resonance at twice an eigenfrequency or a "
                  "sum of two, divided by a whole number); less depth is wanted",
                  pump_hz, growth);
}

bool scratch_make(struct scratch *scratch, const struct parameters *p, bool envelope,
                  struct report *report)
{
    const bool alike = scratch->made && scratch->envelope == envelope;
    const double centre = centre_of(p);
    const bool same_modes = alike && same(&scratch->p.modes, &p->modes, sizeof p->modes) &&
                            (!envelope || scratch->frame.centre == centre);
    if (alike && same(&scratch->p, p, sizeof *p))
        return true;
    scratch->made = false;
    scratch->p = *p;
    scratch->envelope = envelope;
    memset(scratch->has_response, 0, sizeof scratch->has_response);
    memset(scratch->has_turning, 0, sizeof scratch->has_turning);
    scratch->lines[0].made = scratch->lines[1].made = false;
    if (!same_modes) {
        scratch->has_flow = scratch->has_table = false;
        scratch->frame.rotating = envelope;
        scratch->frame.centre = centre;
        scratch->frame.pump_hz = p->modes.pump_hz;
        if (!matrices_of(&p->modes, &scratch->matrices, report))
            return false;
        scratch->fastest_hz = scratch->matrices.eta[MODES - 1];
        for (int i = 0; i < MODES; ++i)
            scratch->fastest_hz = fmax(scratch->fastest_hz, fabs(p->modes.d[i]));
        if (!check_stable(scratch, report))
            return false;
    }
    scratch->made = true;
    return true;
}

/* --- responses ---------------------------------------------------------------------------------- */

static double frequency_at(const struct scratch *scratch, int place)
{
    return place == HELD ? 0.0 : scratch->p.u[place];
}

const struct steady *response_of(struct scratch *scratch, int place, struct report *report)
{
    struct steady *steady = &scratch->response[place];
    if (!scratch->has_response[place] &&
        !steady_of(&scratch->matrices, &scratch->frame, &scratch->p,
                   frequency_at(scratch, place), &scratch->chain, steady, report))
        return NULL;
    scratch->has_response[place] = true;
    return steady;
}

const struct steady *full_response_of(struct scratch *scratch, int place, struct report *report)
{
    struct steady *steady = &scratch->response[RESPONSES];
    struct frame full = scratch->frame;
    if (!scratch->envelope)
        return response_of(scratch, place, report);
    full.rotating = false;
    if (!steady_of(&scratch->matrices, &full, &scratch->p, frequency_at(scratch, place),
                   &scratch->chain, steady, report))
        return NULL;
    return steady;
}

/* The motion under a tone of complex amplitude, without lines that are rounding. */
static bool lines_of(struct scratch *scratch, int place, struct complex amplitude,
                     struct lines *lines, struct report *report)
{
    const struct steady *found = response_of(scratch, place, report);
    double sizes[CHAIN_LENGTH], largest = 0.0;
    if (found == NULL)
        return false;
    for (int i = MOST_SIDEBANDS - found->below; i <= MOST_SIDEBANDS + found->above; ++i) {
        for (int mode = 0; mode < MODES; ++mode) {
            const struct complex z = c_multiply(amplitude, found->sideband[i].x[mode]);
            lines->z[i].x[mode] = complex_of(z.re / FOUR_PI_SQUARED, z.im / FOUR_PI_SQUARED);
        }
        sizes[i] = vector_largest(&lines->z[i]);
        largest = fmax(largest, sizes[i]);
    }
    for (int i = MOST_SIDEBANDS - found->below; i <= MOST_SIDEBANDS + found->above; ++i)
        lines->kept[i] = sizes[i] >= NO_LINE * largest;
    lines->u = found->u;
    lines->frequency = frequency_of(found->u, 0.0);
    lines->made = true;
    return true;
}

double pump_cycles(const struct run *run, double t)
{
    const struct frequency pump = frequency_of(run->p.modes.pump_hz, 0.0);
    return frequency_cycles(&pump, t, 0.0) + run->offsets[2] + run->p.pump_phase / TWO_PI;
}

static double part_of_turn(double cycles)
{
    const double part = fmod(cycles, 1.0);
    return part < 0.0 ? part + 1.0 : part;
}

/* Add the signals of one tone's lines. */
static void add_lines(const struct lines *lines, const struct steady *found, double base,
                      double pump, double pump_hz, struct complex z[STATES])
{
    for (int k = -found->below; k <= found->above; ++k) {
        const int i = MOST_SIDEBANDS + k;
        const struct complex turn = c_rect(1.0, TWO_PI * part_of_turn(base + k * pump));
        const struct complex speed = complex_of(0.0, lines->u + k * pump_hz);
        if (!lines->kept[i])
            continue;
        for (int mode = 0; mode < MODES; ++mode) {
            const struct complex x = lines->z[i].x[mode];
            z[mode] = c_add(z[mode], c_multiply(x, turn));
            z[MODES + mode] =
                c_add(z[MODES + mode], c_multiply(c_multiply(speed, x), turn));
        }
    }
}

bool orbit_at(const struct run *run, struct scratch *scratch, double t, double b,
              struct complex z[STATES], struct report *report)
{
    const double pump = pump_cycles(run, t), pump_hz = run->p.modes.pump_hz;
    memset(z, 0, STATES * sizeof *z);
    for (int i = 0; i < 2; ++i) {
        const struct complex amplitude = c_rect(run->p.size[i], run->p.phase[i]);
        struct lines *lines = &scratch->lines[i];
        if (run->p.size[i] == 0.0)
            continue;
        if (!lines->made && !lines_of(scratch, i, amplitude, lines, report))
            return false;
        add_lines(lines, &scratch->response[i],
                  frequency_cycles(&lines->frequency, t, 0.0) + run->offsets[i], pump, pump_hz, z);
    }
    if (b != 0.0) {
        struct lines *held = &scratch->held;
        if (!lines_of(scratch, HELD, complex_of(b, 0.0), held, report))
            return false;
        add_lines(held, &scratch->response[HELD], 0.0, pump, pump_hz, z);
    }
    return true;
}

/* --- the transient without a pump --------------------------------------------------------------- */

static struct real largest_real(const struct real *y)
{
    struct real largest = real_abs(y[0]);
    for (int i = 1; i < STATES; ++i) {
        const struct real next = real_abs(y[i]);
        if (!real_at_most(next, largest))
            largest = next;
    }
    return largest;
}

/* Velocities over 2 pi as the generator has them, or back. */
static void rescale(const struct scratch *scratch, struct real *y, int direction)
{
    for (int i = MODES; i < STATES && scratch->generator.scaled; ++i)
        y[i] = real_scale(y[i], direction * scratch->generator.scale_power);
}

/* The displacements that a unit input holds; none in a rotating frame. */
static bool still_of(struct scratch *scratch, struct real *still, struct report *report)
{
    const struct real over = real_reciprocal(real_of(FOUR_PI_SQUARED));
    const struct steady *found;
    memset(still, 0, STATES * sizeof *still);
    if (scratch->envelope)
        return true;
    found = response_of(scratch, HELD, report);
    if (found == NULL)
        return false;
    for (int i = 0; i < MODES; ++i)
        still[i] = real_multiply(found->carrier.x[i].re, over);
    return true;
}

/* Both tones' responses times their amplitudes, and the generators of their turning. */
static bool make_driven(struct scratch *scratch, struct report *report)
{
    for (int i = 0; i < 2; ++i) {
        const struct complex drive = c_rect(scratch->p.size[i], scratch->p.phase[i]);
        const struct precise amplitude =
            precise_of(drive.re / FOUR_PI_SQUARED, drive.im / FOUR_PI_SQUARED);
        const struct real u = real_of(scratch->p.u[i]);
        const struct real rows[] = {real_of(0.0), real_negate(u), u, real_of(0.0)};
        const struct steady *found;
        if (scratch->p.size[i] == 0.0 || scratch->has_turning[i])
            continue;
        found = response_of(scratch, i, report);
        if (found == NULL)
            return false;
        for (int mode = 0; mode < MODES; ++mode)
            scratch->driven[i].x[mode] = precise_multiply(amplitude, found->carrier.x[mode]);
        propagator_make(&scratch->turning[i], rows, 2);
        scratch->has_turning[i] = true;
    }
    return true;
}

/* The periodic part as the generator has it. */
static bool exact_orbit(const struct run *run, struct scratch *scratch, struct real *y,
                        struct report *report)
{
    const struct real b = real_of(run->b);
    if (!make_flow(scratch, report) || !make_driven(scratch, report) ||
        !still_of(scratch, y, report))
        return false;
    for (int i = 0; i < STATES; ++i)
        y[i] = real_multiply(b, y[i]);
    for (int i = 0; i < 2; ++i) {
        const struct real u = real_of(run->p.u[i]);
        if (run->p.size[i] == 0.0)
            continue;
        for (int mode = 0; mode < MODES; ++mode) {
            const struct precise z =
                precise_multiply(scratch->driven[i].x[mode], run->exact.turn[i]);
            const struct real w =
                scratch->generator.scaled
                    ? real_scale(real_negate(real_multiply(z.im, u)),
                                 -scratch->generator.scale_power)
                    : z.im;
            y[mode] = real_add(y[mode], z.re);
            y[MODES + mode] = real_add(y[MODES + mode], w);
        }
    }
    return true;
}

/* Begin to turn, at the present time. */
static void set_turns(struct run *run)
{
    for (int i = 0; i < 2; ++i) {
        const struct frequency u = frequency_of(run->p.u[i], 0.0);
        const double cycles = frequency_cycles(&u, run->t, 0.0) + run->offsets[i];
        run->exact.turn[i] = precise_of_complex(c_rect(1.0, TWO_PI * cycles));
    }
}

static bool exact_begin(struct run *run, struct scratch *scratch, struct state state,
                        struct report *report)
{
    struct real orbit[STATES];
    run->exact.begun_at = run->t;
    run->exact.begun = state;
    set_turns(run);
    if (!exact_orbit(run, scratch, orbit, report))
        return false;
    rescale(scratch, state.y, -1);
    for (int i = 0; i < STATES; ++i)
        run->exact.free[i] = real_subtract(state.y[i], orbit[i]);
    run->exact.first = largest_real(run->exact.free);
    return true;
}

static bool exact_advance(struct run *run, struct scratch *scratch, double t,
                          struct report *report)
{
    const struct real dt = real_subtract(real_of(t), real_of(run->t));
    if (!make_flow(scratch, report) || !make_driven(scratch, report))
        return false;
    if (dt.sign) {
        propagator_move(&scratch->flow, run->exact.free, dt);
        for (int i = 0; i < 2; ++i) {
            struct real parts[] = {run->exact.turn[i].re, run->exact.turn[i].im};
            if (run->p.size[i] == 0.0)
                continue;
            propagator_move(&scratch->turning[i], parts, dt);
            run->exact.turn[i].re = parts[0];
            run->exact.turn[i].im = parts[1];
        }
    }
    run->t = t;
    run->in_motion = !real_at_most(largest_real(run->exact.free),
                                   real_multiply(real_of(DECAYED), run->exact.first));
    return true;
}

static bool exact_total(const struct run *run, struct scratch *scratch, struct state *state,
                        struct report *report)
{
    if (!exact_orbit(run, scratch, state->y, report))
        return false;
    for (int i = 0; i < STATES; ++i)
        state->y[i] = real_add(state->y[i], run->exact.free[i]);
    rescale(scratch, state->y, 1);
    return true;
}

/* Hold another input, from the same displacements. */
static bool exact_change_input(struct run *run, struct scratch *scratch, double b,
                               struct report *report)
{
    const struct real less = real_subtract(real_of(run->b), real_of(b));
    struct real still[STATES];
    struct state state;
    if (!still_of(scratch, still, report) || !exact_total(run, scratch, &state, report))
        return false;
    run->exact.begun_at = run->t;
    run->exact.begun = state;
    for (int i = 0; i < STATES; ++i)
        run->exact.free[i] = real_add(run->exact.free[i], real_multiply(less, still[i]));
    run->exact.first = largest_real(run->exact.free);
    return true;
}

/* --- the transient under a pump ------------------------------------------------------------------ */

static double scale_of(const struct scratch *scratch)
{
    return scratch->generator.scaled ? ldexp(1.0, scratch->generator.scale_power) : 1.0;
}

/* Displacements and velocities over 2 pi of the periodic part. */
static bool pumped_orbit(const struct run *run, struct scratch *scratch, double t, double b,
                         double *y, struct report *report)
{
    struct complex z[STATES];
    if (!orbit_at(run, scratch, t, b, z, report))
        return false;
    for (int i = 0; i < MODES; ++i) {
        y[i] = z[i].re;
        y[MODES + i] = run->envelope ? z[i].im : z[MODES + i].re;
    }
    return true;
}

static double largest_double(const double *y)
{
    double largest = 0.0;
    for (int i = 0; i < STATES; ++i)
        largest = fmax(largest, fabs(y[i]));
    return largest;
}

static void set_free(struct run *run)
{
    run->pumped.has_begun = false;
    run->pumped.first = largest_double(run->pumped.free);
}

static bool pumped_begin(struct run *run, struct scratch *scratch, const struct state *state,
                         struct report *report)
{
    double orbit[STATES];
    if (!make_flow(scratch, report) ||
        !pumped_orbit(run, scratch, run->t, run->b, orbit, report))
        return false;
    for (int i = 0; i < STATES; ++i) {
        const double factor = i < MODES ? 1.0 : 1.0 / scale_of(scratch);
        run->pumped.free[i] = (real_double(state->y[i]) - orbit[i]) * factor;
    }
    set_free(run);
    return true;
}

/* Integrate to t, or to where a period begins before. */
static void follow(struct run *run, struct scratch *scratch, double t)
{
    const struct frame *frame = &scratch->frame;
    const double cycles = part_of_turn(pump_cycles(run, run->t)), span = t - run->t;
    const double rest = (1.0 - cycles) / frame->pump_hz;
    const double fastest = frame->rotating ? fmax(scratch->fastest_hz, 2.0 * frame->centre)
                                           : scratch->fastest_hz;
    /* whether a table of a pump period takes less time than it saves */
    const bool to_period = fastest <= MOST_PERIODS * frame->pump_hz && rest <= span;
    pumped_move(&scratch->pumped_flow, run->pumped.free, to_period ? rest : span,
                TWO_PI * cycles);
    if (!to_period)
        return;
    run->pumped.has_begun = true;
    run->pumped.begun_at = run->t + rest;
    memcpy(run->pumped.begun, run->pumped.free, sizeof run->pumped.begun);
}

static void from_table(struct run *run, struct scratch *scratch, double t)
{
    /* the pump's own phase says where in the period t is; the count only needs to be near */
    const double fraction = part_of_turn(pump_cycles(run, t));
    const double periods =
        nearbyint((t - run->pumped.begun_at) * scratch->frame.pump_hz - fraction);
    make_table(scratch);
    memcpy(run->pumped.free, run->pumped.begun, sizeof run->pumped.free);
    period_table_move(&scratch->table, &scratch->pumped_flow, run->pumped.free,
                      periods > 0.0 ? (uint64_t)periods : 0, periods >= 0.0 ? fraction : 0.0);
}

static bool pumped_advance(struct run *run, struct scratch *scratch, double t,
                           struct report *report)
{
    if (!make_flow(scratch, report))
        return false;
    if (t > run->t) {
        if (!run->pumped.has_begun)
            follow(run, scratch, t);
        if (run->pumped.has_begun)
            from_table(run, scratch, t);
    }
    run->t = t;
    run->in_motion = !(largest_double(run->pumped.free) <= DECAYED * run->pumped.first);
    return true;
}

static bool pumped_total(const struct run *run, struct scratch *scratch, double *y,
                         struct report *report)
{
    if (!make_flow(scratch, report) || !pumped_orbit(run, scratch, run->t, run->b, y, report))
        return false;
    for (int i = 0; i < STATES; ++i)
        y[i] = run->pumped.free[i] * (i < MODES ? 1.0 : scale_of(scratch)) + y[i];
    return true;
}

/* Hold another input, from the same displacements and velocities. */
static bool pumped_change_input(struct run *run, struct scratch *scratch, double b,
                                struct report *report)
{
    double before[STATES], now[STATES];
    if (!make_flow(scratch, report) ||
        !pumped_orbit(run, scratch, run->t, run->b, before, report) ||
        !pumped_orbit(run, scratch, run->t, b, now, report))
        return false;
    for (int i = 0; i < STATES; ++i)
        run->pumped.free[i] +=
            (before[i] - now[i]) * (i < MODES ? 1.0 : 1.0 / scale_of(scratch));
    set_free(run);
    return true;
}

/* --- the course of a run ------------------------------------------------------------------------- */

bool run_start(struct run *run, struct scratch *scratch, double t, const struct state *state,
               double b, struct report *report)
{
    if (b != 0.0 && run->envelope)
        return refuse(report,
                      "b = %r: the rotating frame of solver 1 (envelope) cannot carry an arbitrary "
                      "input; use solver 0 (exact) or 2 (rk4)",
                      b);
    run->b = b;
    run->t = t;
    run->in_motion = state != NULL;
    for (int i = 0; i < 2; ++i) /* refused now rather than when it is read */
        if (run->p.size[i] != 0.0 && response_of(scratch, i, report) == NULL)
            return false;
    if (state == NULL)
        return true;
    return pumped(&run->p.modes) ? pumped_begin(run, scratch, state, report)
                                 : exact_begin(run, scratch, *state, report);
}

bool run_advance(struct run *run, struct scratch *scratch, double t, struct report *report)
{
    if (!run->in_motion)
        return true;
    return pumped(&run->p.modes) ? pumped_advance(run, scratch, t, report)
                                 : exact_advance(run, scratch, t, report);
}

bool run_displacement(const struct run *run, struct scratch *scratch, double t, double *q,
                      struct report *report)
{
    struct complex z[STATES];
    double y[STATES];
    struct state state;
    if (!run->in_motion) {
        if (!orbit_at(run, scratch, t, run->b, z, report))
            return false;
        for (int i = 0; i < MODES; ++i)
            q[i] = z[i].re;
        return true;
    }
    if (pumped(&run->p.modes)) {
        if (!pumped_total(run, scratch, y, report))
            return false;
        memcpy(q, y, MODES * sizeof *q);
        return true;
    }
    if (!exact_total(run, scratch, &state, report))
        return false;
    for (int i = 0; i < MODES; ++i)
        q[i] = real_double(state.y[i]);
    return true;
}

bool run_state(const struct run *run, struct scratch *scratch, double t, struct state *state,
               struct report *report)
{
    double y[STATES];
    if (run->in_motion && !pumped(&run->p.modes))
        return exact_total(run, scratch, state, report);
    if (!(run->in_motion ? pumped_total(run, scratch, y, report)
                         : pumped_orbit(run, scratch, t, run->b, y, report)))
        return false;
    for (int i = 0; i < STATES; ++i)
        state->y[i] = real_of(y[i]);
    return true;
}

bool run_with_input(struct run *run, struct scratch *scratch, double b, double t,
                    struct report *report)
{
    const bool by_pump = pumped(&run->p.modes);
    if (run->envelope)
        return run_start(run, scratch, t, NULL, b, report); /* refuses */
    if (!run->in_motion) {
        run->in_motion = true;
        run->t = t;
        if (by_pump) {
            memset(&run->pumped, 0, sizeof run->pumped);
        } else {
            memset(&run->exact, 0, sizeof run->exact);
            set_turns(run);
        }
    }
    run->since = t;
    if (!(by_pump ? pumped_change_input(run, scratch, b, report)
                  : exact_change_input(run, scratch, b, report)))
        return false;
    run->b = b;
    return true;
}
