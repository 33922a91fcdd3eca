/* The steps are the solver's own: it runs past a communication point as far as the tolerance lets it
 * and answers for the times in between, so the cut of a run into communication steps does not change
 * a bit of the result. Only a change of parameters ends a step. */
#include "duffing_envelope.h"

#include <string.h>

#include "duffing_orbit.h"

/* Share of the tolerance that one step may take: the errors of a few are alive at a time. */
#define PER_STEP 0.03
/* Tolerance of the steps that settle, while what they miss has the time to be forgotten. */
#define SETTLING 1e-2
/* Steps in a period that are kept in Python: a motion that needs more goes on by steps. */
#define MOST_STEPS 20000

bool envelope_prepare(struct envelope_solver *solver, const struct parameters *p,
                      const struct envelope_settings *settings, const double offsets[2],
                      struct report *report)
{
    const struct complex *rates = solver->model.plane.rates;
    double growth;
    memset(solver, 0, sizeof *solver);
    solver->tolerance = settings->tolerance;
    solver->upper = settings->upper;
    solver->offsets[0] = offsets[0];
    solver->offsets[1] = offsets[1];
    if (!slow_prepare(&solver->model, p, &settings->cubic, offsets, report))
        return false;
    growth = fmax(rates[0].re, rates[1].re);
    solver->longest = growth > 0.0 ? 1.0 / growth : INFINITY;
    solver->settling = -INFINITY;
    return true;
}

bool envelope_refuse_input(double b, struct report *report)
{
    if (b == 0.0)
        return true;
    return refuse(report,
                  "b = %r: the rotating frame of solver 1 (envelope) cannot carry an arbitrary "
                  "input; use solver 2 (rk4)",
                  b);
}

/* The time of the first period that a time is a copy of. */
static double within_period(const struct period *period, double t)
{
    const double count = floor((t - period->begin) / period->length);
    if (!(count > 0.0))
        return t;
    return fmin(fmax(t - count * period->length, period->begin), period->begin + period->length);
}

/* w at a time within the last step, or at one that is a copy of it. */
static struct pair slow_at(const struct envelope_solver *solver, double t)
{
    const struct slow_model *model = &solver->model;
    const struct frequency *detuning = &model->tone[0].detuning;
    const double first = solver->period.known ? within_period(&solver->period, t) : t;
    struct pair w = solver->w;
    struct complex turn;
    if (!solver->stepped)
        return w;
    if (first != solver->t)
        w = step_between(&solver->step, model->plane.rates, first);
    if (first == t)
        return w;
    turn = c_rect(1.0, TWO_PI * (frequency_cycles(detuning, t, 0.0) -
                                 frequency_cycles(detuning, first, 0.0)));
    for (int i = 0; i < 2; ++i)
        w.z[i] = c_multiply(w.z[i], turn);
    return w;
}

struct pair envelope_amplitudes(const struct envelope_solver *solver, double t)
{
    return slow_amplitudes(&solver->model, slow_at(solver, t), slow_linear(&solver->model, t));
}

double envelope_averaging_error(const struct envelope_solver *solver, double t, double eps)
{
    return slow_averaging_error(&solver->model, slow_at(solver, t), t, eps);
}

struct state envelope_state(const struct envelope_solver *solver, double t)
{
    return slow_full_state(&solver->model, slow_at(solver, t), t);
}

/* Stand at t with w, of which nothing else changes. */
static void stand(struct envelope_solver *solver, double t, struct pair w)
{
    const struct pair linear = slow_linear(&solver->model, t);
    struct pair q;
    solver->stepped = false;
    solver->t = t;
    solver->w = w;
    slow_slope(&solver->model, &w, &linear, &solver->n, &q);
}

/* Stand at t with w, before the first step. */
static void begin(struct envelope_solver *solver, double t, struct pair w)
{
    const struct complex *rates = solver->model.plane.rates;
    const double fastest = fmax(fabs(rates[0].re), fabs(rates[1].re));
    struct pair q;
    stand(solver, t, w);
    q = envelope_amplitudes(solver, t);
    solver->scale[0] = c_abs(q.z[0]);
    solver->scale[1] = c_abs(q.z[1]);
    solver->next = fastest != 0.0 ? 0.1 / fastest : 10.0 / solver->model.centre;
}

/* Begin where the motion from w (NULL: rest) long before has come to. */
static bool settle(struct envelope_solver *solver, double t, const struct pair *w,
                   struct report *report)
{
    const struct complex *rates = solver->model.plane.rates;
    const int32_t lone = solver->model.lone;
    const double decay = lone < 0 ? fmin(-rates[0].re, -rates[1].re) : -rates[lone].re;
    const double before = t - log(100.0 / solver->tolerance) / decay;
    struct state at_rest;
    struct pair reached;
    memset(&at_rest, 0, sizeof at_rest);
    begin(solver, before, w != NULL ? *w : slow_from_state(&solver->model, &at_rest, before));
    solver->settling = t;
    solver->decay = decay;
    if (!envelope_advance(solver, t, report))
        return false;
    solver->settling = -INFINITY;
    reached = slow_at(solver, t);
    if (lone >= 0) /* the other mode is linear: its deviation is gone in the end */
        reached.z[1 - lone] = complex_of(0.0, 0.0);
    begin(solver, t, reached);
    return true;
}

/* Let every period of the settled motion from t on be a copy of the first. */
static void repeat(struct envelope_solver *solver, double t)
{
    const struct slow_tone *tone = solver->model.tone;
    struct period *period = &solver->period;
    period->begin = t;
    period->length = 1.0 / fabs(tone[0].detuning.high - tone[1].detuning.high);
    period->known = isfinite(period->length) && t < t + period->length;
    period->steps = 0;
    period->w = solver->w;
    period->next = solver->next;
    for (int i = 0; i < 2; ++i)
        period->scale[i] = solver->scale[i];
}

/* Begin on the periodic orbit of one tone, on the branch that was named. */
static bool start_on_orbit(struct envelope_solver *solver, double t, struct report *report)
{
    const struct slow_model *model = &solver->model;
    const struct pair linear = slow_linear(model, t), nothing = {{{0.0, 0.0}, {0.0, 0.0}}};
    struct pair guess, w;
    bool found;
    if (c_is_zero(linear.z[0]) && c_is_zero(linear.z[1])) {
        begin(solver, t, nothing);
        return true;
    }
    guess = slow_deviation(model, averaged_orbit(model, linear, solver->upper), linear);
    w = guess;
    if (!fixed_point(model, linear, &w, &found, report))
        return false;
    if (!found) /* at the edge of a branch only the motion itself knows where it ends */
        return settle(solver, t, &guess, report);
    begin(solver, t, w);
    return true;
}

bool envelope_start(struct envelope_solver *solver, double t, const struct state *state, double b,
                    struct report *report)
{
    const struct slow_model *model = &solver->model;
    const struct pair nothing = {{{0.0, 0.0}, {0.0, 0.0}}};
    const bool one =
        model->tones < 2 || model->tone[0].detuning.high == model->tone[1].detuning.high;
    if (!envelope_refuse_input(b, report))
        return false;
    if (state != NULL)
        begin(solver, t, slow_from_state(model, state, t));
    else if (!any_cubic(&model->cubic))
        begin(solver, t, nothing);
    else if (one)
        return start_on_orbit(solver, t, report);
    else if (solver->upper)
        return refuse(report,
                      "branch = 1: the upper branch is that of one active tone (A1 = 0 or A2 = 0), "
                      "not of two, at u1 = %r Hz and u2 = %r Hz",
                      model->p.u1, model->p.u2);
    else if (settle(solver, t, NULL, report))
        repeat(solver, t);
    else
        return false;
    return true;
}

/* --- motion ------------------------------------------------------------------------------------ */

/* The linear response after a part of a step. */
static struct pair linear_onwards(const struct envelope_solver *solver, const struct turns *by)
{
    struct turns turns = slow_turns(&solver->model, solver->t);
    for (int k = 0; k < solver->model.tones; ++k)
        turns.z[k] = c_multiply(turns.z[k], by->z[k]);
    return slow_turned(&solver->model, &turns);
}

static struct step attempt(struct envelope_solver *solver, double h)
{
    const struct slow_model *model = &solver->model;
    struct beginning from = {.t = solver->t, .y = solver->w, .n = solver->n};
    if (!solver->weighed || solver->weighed_step != h) {
        for (int i = 0; i < 2; ++i)
            solver->weights[i] = weights_of(model->plane.rates[i], h);
        solver->to_probe = slow_onwards(model, probe_place() * h);
        solver->to_middle = slow_onwards(model, 0.5 * h);
        solver->weighed = true;
        solver->weighed_step = h;
    }
    from.probed = linear_onwards(solver, &solver->to_probe);
    from.middle = linear_onwards(solver, &solver->to_middle);
    from.there = slow_linear(model, solver->t + h);
    return step_from(&from, h, solver->weights, slow_slope, model);
}

/* Refuse where the averaging does not hold or the numbers end. */
static bool check_step(const struct envelope_solver *solver, const struct step *step, double worst,
                       struct report *report)
{
    const double squares[] = {step->largest[0] * step->largest[0],
                              step->largest[1] * step->largest[1]};
    const double found = cubic_shift(&solver->model.cubic, squares, solver->model.centre);
    const double end = step->t + step->h;
    if (!isfinite(worst) || !isfinite(squares[0]) || !isfinite(squares[1]))
        return refuse(report, "the envelope left the range of numbers after t = %r s", solver->t);
    if (worst <= 1.0 && !(found <= LARGEST_SHIFT))
        return refuse(report,
                      "the cubic terms shift the frequency by %r of the drive's at t = %r s, beyond "
                      "the %r up to which an envelope holds; use solver 2 (rk4)",
                      found, end, LARGEST_SHIFT);
    if (end == step->t)
        return refuse(report, "the envelope cannot keep its tolerance %r at t = %r s",
                      solver->tolerance, step->t);
    return true;
}

/* What a step may miss; what is missed while settling is forgotten as it decays. */
static double step_tolerance(const struct envelope_solver *solver)
{
    const double wanted = solver->tolerance, left = solver->settling - solver->t;
    if (!(left > 0.0) || wanted >= SETTLING)
        return wanted;
    return wanted * exp(fmin(solver->decay * left, log(SETTLING / wanted)));
}

/* The error of a step over its tolerance, relative to the largest amplitudes, as they are
 * forgotten. */
static double judge(const struct envelope_solver *solver, const struct step *step,
                    double scale[2])
{
    double worst = 0.0;
    for (int i = 0; i < 2; ++i) {
        const double kept =
            solver->scale[i] * exp(fmin(solver->model.plane.rates[i].re, 0.0) * step->h);
        const double error = step->error[i];
        scale[i] = fmax(kept, step->largest[i]);
        if (isnan(error))
            return NAN;
        if (scale[i] != 0.0)
            worst = fmax(worst, error / scale[i]);
    }
    return worst / (PER_STEP * step_tolerance(solver));
}

/* Take one step as long as the tolerance allows. */
static bool take(struct envelope_solver *solver, struct report *report)
{
    double h = notched(fmin(solver->next, solver->longest)), factor, scale[2];
    for (;;) {
        const struct step step = attempt(solver, h);
        const double worst = judge(solver, &step, scale);
        if (!check_step(solver, &step, worst, report))
            return false;
        factor = worst != 0.0 ? fmin(5.0, 0.9 * pow(worst, -0.25)) : 5.0;
        if (worst <= 1.0) {
            solver->step = step;
            break;
        }
        h = notched(h * fmax(0.2, factor));
    }
    solver->next = h * fmax(0.2, factor);
    solver->scale[0] = scale[0];
    solver->scale[1] = scale[1];
    solver->stepped = true;
    solver->t = solver->step.t + solver->step.h;
    solver->w = solver->step.y_end;
    solver->n = solver->step.n_end;
    if (solver->period.known)
        solver->period.known = ++solver->period.steps < MOST_STEPS;
    return true;
}

static bool move(struct envelope_solver *solver, double t, struct report *report)
{
    while (solver->t < t)
        if (!take(solver, report))
            return false;
    return true;
}

/* Stand where the period begins, as when it began. */
static void rewind_period(struct envelope_solver *solver)
{
    struct period *period = &solver->period;
    stand(solver, period->begin, period->w);
    solver->next = period->next;
    for (int i = 0; i < 2; ++i)
        solver->scale[i] = period->scale[i];
    period->steps = 0;
}

bool envelope_advance(struct envelope_solver *solver, double t, struct report *report)
{
    if (solver->period.known) {
        const double first = within_period(&solver->period, t);
        if (solver->stepped && first < solver->step.t)
            rewind_period(solver);
        if (!move(solver, first, report))
            return false;
    }
    return solver->period.known || move(solver, t, report);
}
