/* What ModelSlave of fmu_src/slave.py does: no call fails fatally. The sentence goes to the logger
 * and to status_message, every Real output becomes NaN, and each further step is discarded. */
#include "slave.h"

#include <math.h>
#include <string.h>

void slave_start(struct slave *slave)
{
    memset(slave, 0, STATE_SIZE);
    slave->phase = INSTANTIATED;
    slave->moving_stale = slave->steady_stale = true;
    for (int i = 0; i < VARIABLE_COUNT; ++i)
        slave->values[i] = variables[i].start;
}

void slave_fail(struct slave *slave, struct report *report)
{
    slave->phase = FAILED;
    for (int i = 0; i < VARIABLE_COUNT; ++i)
        if (variables[i].causality == OUTPUT && variables[i].kind == REAL)
            slave->values[i] = NAN;
    slave->moving_stale = slave->steady_stale = slave->changed = false;
    slave->message = report->refusal;
}

void slave_enter_initialisation(struct slave *slave)
{
    if (slave->phase == FAILED)
        return; /* only a reset mends what was refused before */
    slave->phase = INITIALISING;
    slave->changed = true;
}

/* Bring the model in line with parameters set since the last communication point. */
static bool settled(struct slave *slave, struct report *report)
{
    if (!slave->changed)
        return true;
    slave->moving_stale = slave->steady_stale = true;
    if (!isfinite(slave->time))
        return refuse(report, "the start time %r s is not a finite number", slave->time);
    if (!(slave->phase == STEPPING ? model_change : model_begin)(slave, slave->time, report))
        return false;
    slave->changed = false;
    return true;
}

void slave_settle(struct slave *slave, struct report *report)
{
    if (!settled(slave, report))
        slave_fail(slave, report);
}

void slave_exit_initialisation(struct slave *slave, struct report *report)
{
    if (slave->phase == INSTANTIATED) {
        refuse(report, "the simulation has not been initialised");
        slave_fail(slave, report);
        return;
    }
    slave_settle(slave, report);
    if (slave->phase != FAILED)
        slave->phase = STEPPING;
}

static bool stepped(struct slave *slave, double t, double step, struct report *report)
{
    const double slack = 1e-6 * step + 1e-9 * fabs(t);
    if (!settled(slave, report))
        return false;
    if (!(step >= 0.0 && fabs(t - slave->time) <= slack))
        return refuse(report,
                      "doStep at %r s by %r s does not follow the communication point %r s", t,
                      step, slave->time);
    if (!isfinite(t + step))
        return refuse(report, "doStep at %r s by %r s has no end", t, step);
    if (slave->phase != INITIALISING && slave->phase != STEPPING)
        return refuse(report, "the simulation has not been initialised");
    if (!model_step(slave, t, t + step, report))
        return false;
    slave->time = t + step;
    slave->moving_stale = true;
    return true;
}

bool slave_step(struct slave *slave, double t, double step, struct report *report)
{
    if (slave->phase == FAILED)
        return false;
    if (!stepped(slave, t, step, report)) {
        slave_fail(slave, report);
        return false;
    }
    return true;
}

static bool update_moving(struct slave *slave, struct report *report)
{
    double outputs[MOVING_COUNT], total = 0.0;
    int next = 0;
    if (!settled(slave, report) || !model_moving(slave, outputs, report))
        return false;
    for (int i = 0; i < VARIABLE_COUNT; ++i)
        if (variables[i].moving)
            slave->values[i] = outputs[next++];
    for (int i = 0; i < MOVING_COUNT; ++i)
        total += outputs[i];
    slave->moving_stale = false;
    if (!isfinite(total))
        return refuse(report, "the motion left the range of numbers at t = %r s", slave->time);
    return true;
}

static bool is_steady(const struct variable *variable)
{
    return variable->causality == OUTPUT && variable->kind == REAL && !variable->moving;
}

static bool update_steady(struct slave *slave, struct report *report)
{
    double outputs[STEADY_COUNT];
    int next = 0;
    if (!settled(slave, report) || !model_steady(slave, outputs, report))
        return false;
    for (int i = 0; i < VARIABLE_COUNT; ++i)
        if (is_steady(&variables[i]))
            slave->values[i] = outputs[next++];
    slave->steady_stale = false;
    return true;
}

/* Outputs are evaluated when first asked for at a communication point. */
static void update(struct slave *slave, const unsigned *references, size_t count,
                   struct report *report)
{
    bool steady = false;
    if (slave->phase == INSTANTIATED)
        return;
    if ((slave->moving_stale || slave->changed) && !update_moving(slave, report))
        slave_fail(slave, report);
    for (size_t i = 0; i < count && !steady; ++i)
        steady = references[i] < VARIABLE_COUNT && is_steady(&variables[references[i]]);
    if (steady && slave->steady_stale && !update_steady(slave, report))
        slave_fail(slave, report);
}

bool slave_knows(enum kind kind, unsigned reference)
{
    return reference < VARIABLE_COUNT && variables[reference].kind == kind;
}

bool slave_says(const struct slave *slave, unsigned reference, const char *text)
{
    return slave_knows(STRING, reference) && text != NULL &&
           strcmp(text, slave->message.text) == 0;
}

/* Refuse references that are not of a kind, with all of them in the sentence as a list. */
static bool of_kind(enum kind kind, const unsigned *references, size_t count, const char *verb,
                    struct report *report)
{
    static const char *const kinds[] = {"Real", "Integer", "Boolean", "String"};
    struct sentence list = {""}, longer;
    bool good = true;
    for (size_t i = 0; i < count; ++i)
        good = good && slave_knows(kind, references[i]);
    if (good)
        return true;
    for (size_t i = 0; i < count; ++i) {
        say(&longer, "%s%s%d", list.text, i ? ", " : "", (int)references[i]);
        list = longer;
    }
    if (kind == REAL && *verb == 'g')
        return refuse(report, "getReal: [%s] names a variable that is not a Real", list.text);
    return refuse(report, "%s%s: [%s] names a variable that is not of this type", verb,
                  kinds[kind], list.text);
}

void slave_get(struct slave *slave, enum kind kind, const unsigned *references, size_t count,
               double *values, struct report *report)
{
    if (kind == REAL)
        update(slave, references, count, report);
    if (!of_kind(kind, references, count, "get", report)) {
        slave_fail(slave, report);
        for (size_t i = 0; i < count; ++i)
            values[i] = kind == REAL ? NAN : 0.0;
        return;
    }
    for (size_t i = 0; i < count; ++i)
        values[i] = slave->values[references[i]];
}

static void write_value(struct sentence *text, enum kind kind, double value)
{
    if (kind == BOOLEAN)
        say(text, value != 0.0 ? "True" : "False");
    else if (kind == INTEGER)
        say(text, "%d", (int)value);
    else
        say(text, "%r", value);
}

/* Refuse what FMI does not let change at this moment. */
static bool set_one(struct slave *slave, unsigned reference, double value, struct report *report)
{
    const struct variable *variable = &variables[reference];
    struct sentence before, after;
    if (slave->values[reference] == value)
        return true;
    if (variable->causality == OUTPUT)
        return refuse(report, "%s is an output and cannot be set", variable->name);
    if (variable->causality == PARAMETER && slave->phase == STEPPING && variable->fixed) {
        write_value(&before, variable->kind, slave->values[reference]);
        write_value(&after, variable->kind, value);
        return refuse(report,
                      "%s is fixed after initialisation and cannot be changed from %s to %s",
                      variable->name, before.text, after.text);
    }
    if (variable->causality == PARAMETER)
        slave->changed = slave->phase == INITIALISING || slave->phase == STEPPING;
    else if (slave->phase == INITIALISING)
        slave->changed = true;
    slave->values[reference] = value;
    return true;
}

void slave_set(struct slave *slave, enum kind kind, const unsigned *references, size_t count,
               const double *values, struct report *report)
{
    bool good = of_kind(kind, references, count, "set", report);
    for (size_t i = 0; i < count && good; ++i)
        good = set_one(slave, references[i], values[i], report);
    if (!good)
        slave_fail(slave, report);
}

/* --- directional derivatives -------------------------------------------------------------------- */

/* Refuse what nothing, or nothing smooth, depends on. */
static bool write_seed(const unsigned *knowns, size_t count, const double *seed, double *all,
                       struct report *report)
{
    memset(all, 0, VARIABLE_COUNT * sizeof *all);
    for (size_t i = 0; i < count; ++i) {
        const struct variable *variable =
            knowns[i] < VARIABLE_COUNT ? &variables[knowns[i]] : NULL;
        if (variable == NULL || variable->kind != REAL || variable->causality == OUTPUT ||
            variable->fixed)
            return refuse(report,
                          "getDirectionalDerivative: variable %d is neither an input nor a tunable "
                          "parameter",
                          (int)knowns[i]);
        all[knowns[i]] += seed[i];
    }
    return true;
}

static bool check_unknowns(const unsigned *unknowns, size_t count, struct report *report)
{
    for (size_t i = 0; i < count; ++i)
        if (unknowns[i] >= VARIABLE_COUNT || variables[unknowns[i]].causality != OUTPUT ||
            variables[unknowns[i]].kind != REAL)
            return refuse(report, "getDirectionalDerivative: variable %d is no Real output",
                          (int)unknowns[i]);
    return true;
}

bool slave_derivative(struct slave *slave, const unsigned *unknowns, size_t unknown_count,
                      const unsigned *knowns, size_t known_count, const double *seed,
                      double *derivatives, struct report *report)
{
    double all[VARIABLE_COUNT], found[VARIABLE_COUNT];
    double moving[MOVING_COUNT], steady[STEADY_COUNT];
    int next_moving = 0, next_steady = 0;
    if (slave->phase != INITIALISING && slave->phase != STEPPING)
        return refuse(report, "getDirectionalDerivative: the simulation has not been initialised");
    if (!check_unknowns(unknowns, unknown_count, report) ||
        !write_seed(knowns, known_count, seed, all, report))
        return false;
    slave_settle(slave, report);
    if (slave->phase == FAILED || !model_derivative(slave, all, moving, steady, report))
        return false;
    for (int i = 0; i < VARIABLE_COUNT; ++i) {
        found[i] = NAN;
        if (variables[i].moving)
            found[i] = moving[next_moving++];
        else if (is_steady(&variables[i]))
            found[i] = steady[next_steady++];
    }
    for (size_t i = 0; i < unknown_count; ++i) {
        derivatives[i] = found[unknowns[i]];
        if (!isfinite(derivatives[i]))
            return refuse(report,
                          "getDirectionalDerivative: %s has no derivative in closed form with these "
                          "settings",
                          variables[unknowns[i]].name);
    }
    return true;
}
