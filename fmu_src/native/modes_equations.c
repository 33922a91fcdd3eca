#include "modes_equations.h"

#include <string.h>

bool pumped(const struct modes *modes)
{
    bool any = false;
    for (int i = 0; i < MODES; ++i)
        any = any || modes->depth_f[i] != 0.0;
    for (int i = 0; i < PAIRS; ++i)
        any = any || modes->depth_coupling[i] != 0.0;
    return any;
}

double least_of(const double *x)
{
    double least = x[0];
    for (int i = 1; i < MODES; ++i)
        least = fmin(least, x[i]);
    return least;
}

double largest_of(const double *x)
{
    double largest = x[0];
    for (int i = 1; i < MODES; ++i)
        largest = fmax(largest, x[i]);
    return largest;
}

/* --- what has no meaning ---------------------------------------------------------------------- */

/* The digits of the pair at a place: 12, 13, ... */
static int mark_of(int place)
{
    int next = 0;
    for (int i = 1; i <= MODES; ++i)
        for (int j = i + 1; j <= MODES; ++j)
            if (next++ == place)
                return 10 * i + j;
    return 0;
}

static bool finite(const char *stem, int number, double value, struct report *report)
{
    if (isfinite(value))
        return true;
    return number ? refuse(report, "%s%d = %r is not a finite number", stem, number, value)
                  : refuse(report, "%s = %r is not a finite number", stem, value);
}

static bool all_finite(const char *stem, const double *values, struct report *report)
{
    for (int i = 0; i < MODES; ++i)
        if (!finite(stem, i + 1, values[i], report))
            return false;
    return true;
}

static bool pairs_finite(const char *stem, const double *values, struct report *report)
{
    for (int i = 0; i < PAIRS; ++i)
        if (!finite(stem, mark_of(i), values[i], report))
            return false;
    return true;
}

static bool check_finite(const struct parameters *p, struct report *report)
{
    const struct modes *m = &p->modes;
    return all_finite("f", m->f, report) && all_finite("d", m->d, report) &&
           all_finite("g", p->g, report) && all_finite("depth_f", m->depth_f, report) &&
           pairs_finite("lambda", m->coupling, report) &&
           pairs_finite("depth_lambda", m->depth_coupling, report) &&
           finite("u", 1, p->u[0], report) && finite("u", 2, p->u[1], report) &&
           finite("A", 1, p->size[0], report) && finite("A", 2, p->size[1], report) &&
           finite("phase", 1, p->phase[0], report) && finite("phase", 2, p->phase[1], report) &&
           finite("pump_hz", 0, m->pump_hz, report) &&
           finite("pump_phase", 0, p->pump_phase, report);
}

static bool check_signs(const struct parameters *p, struct report *report)
{
    const struct modes *m = &p->modes;
    for (int i = 0; i < MODES; ++i)
        if (m->f[i] <= 0.0)
            return refuse(report, "f%d = %r Hz: an eigenfrequency must be above 0 Hz", i + 1,
                          m->f[i]);
    for (int i = 0; i < PAIRS; ++i)
        if (m->coupling[i] < 0.0)
            return refuse(report,
                          "lambda%d = %r Hz: a coupling must not be negative (its square counts; a "
                          "force of the other sign is that of a mode with g and readout negated)",
                          mark_of(i), m->coupling[i]);
    for (int i = 0; i < 2; ++i)
        if (p->u[i] < 0.0)
            return refuse(report, "u%d = %r Hz: a drive frequency must not be negative", i + 1,
                          p->u[i]);
    if (pumped(m) && m->pump_hz <= 0.0)
        return refuse(report,
                      "pump_hz = %r Hz: a pump with depths that are not 0 needs a frequency above 0 "
                      "Hz",
                      m->pump_hz);
    return true;
}

bool check_parameters(const struct parameters *p, bool periodic_start, struct report *report)
{
    if (!check_finite(p, report) || !check_signs(p, report))
        return false;
    for (int i = 0; i < MODES; ++i) {
        const double d = p->modes.d[i];
        if (d > 0.0)
            continue;
        if (periodic_start)
            return refuse(report,
                          "d%d = %r Hz: the damping matrix is not positive definite, so there is no "
                          "attracting periodic orbit to start on; set periodic_start to false",
                          i + 1, d);
        if (pumped(&p->modes))
            return refuse(report,
                          "d%d = %r Hz: a pumped system needs a damping above 0 Hz of every mode",
                          i + 1, d);
        if (d < 0.0)
            warn(report, "d%d = %r Hz is negative: the oscillation may grow", i + 1, d);
    }
    return true;
}

/* --- matrices --------------------------------------------------------------------------------- */

static struct real product3(double a, double b, double c)
{
    return real_multiply(real_multiply(real_of(a), real_of(b)), real_of(c));
}

/* diag(f^2) - lambda^2, each entry times its factor (NULL: 1). */
static void symmetric(const struct modes *modes, const double *on_f, const double *on_coupling,
                      struct real rows[MODES][MODES])
{
    int place = 0;
    for (int i = 0; i < MODES; ++i) {
        rows[i][i] = product3(modes->f[i], modes->f[i], on_f ? on_f[i] : 1.0);
        for (int j = i + 1; j < MODES; ++j, ++place) {
            const double size = modes->coupling[place];
            rows[i][j] = rows[j][i] =
                product3(-size, size, on_coupling ? on_coupling[place] : 1.0);
        }
    }
}

/* Name the couplings among the first modes. */
static void name_couplings(const struct modes *modes, int last, struct sentence *names)
{
    struct sentence longer;
    int place = 0;
    names->text[0] = '\0';
    for (int i = 0; i < MODES; ++i)
        for (int j = i + 1; j < MODES; ++j, ++place) {
            if (modes->coupling[place] == 0.0 || j > last)
                continue;
            say(&longer, "%s%slambda%d = %r Hz", names->text, names->text[0] ? ", " : "",
                mark_of(place), modes->coupling[place]);
            *names = longer;
        }
}

/* Refuse where a pivot of the elimination is not positive (Sylvester). */
static bool check_positive(const struct modes *modes, const struct matrices *m,
                           struct report *report)
{
    struct real rows[MODES][MODES];
    struct sentence names;
    memcpy(rows, m->stiffness, sizeof rows);
    for (int i = 0; i < MODES; ++i) {
        if (rows[i][i].sign <= 0) {
            name_couplings(modes, i, &names);
            return refuse(report,
                          "the stiffness matrix is not positive definite: with f%d = %r Hz and %s "
                          "the modes have a motion without a restoring force; weaker coupling is "
                          "wanted",
                          i + 1, modes->f[i], names.text);
        }
        for (int k = i + 1; k < MODES; ++k) {
            const struct real factor =
                real_multiply(rows[k][i], real_reciprocal(rows[i][i]));
            for (int j = i; j < MODES; ++j)
                rows[k][j] = real_subtract(rows[k][j], real_multiply(factor, rows[i][j]));
        }
    }
    return true;
}

/* A bound of the 2-norm of C^-1/2 C_p C^-1/2. */
static double relative_of(const struct matrices *m, const double values[MODES])
{
    double turned[MODES * MODES];
    for (int i = 0; i < MODES; ++i)
        for (int j = 0; j < MODES; ++j) {
            double sum = 0.0;
            for (int k = 0; k < MODES; ++k)
                for (int l = 0; l < MODES; ++l)
                    sum += m->shapes[k][i] * m->pump_values[k][l] * m->shapes[l][j];
            turned[MODES * i + j] =
                sum / sqrt(fmax(values[i], 1e-300) * fmax(values[j], 1e-300));
        }
    return norm_of(turned, MODES * MODES) * (1.0 + 1e-9);
}

bool matrices_of(const struct modes *modes, struct matrices *m, struct report *report)
{
    double values[MODES];
    symmetric(modes, NULL, NULL, m->stiffness);
    symmetric(modes, modes->depth_f, modes->depth_coupling, m->pump);
    if (!check_positive(modes, m, report))
        return false;
    for (int i = 0; i < MODES; ++i) {
        m->damping[i] = real_of(modes->d[i]);
        m->damping_values[i] = modes->d[i];
        for (int j = 0; j < MODES; ++j) {
            m->stiffness_values[i][j] = real_double(m->stiffness[i][j]);
            m->pump_values[i][j] = real_double(m->pump[i][j]);
        }
    }
    eigensystem(m->stiffness_values, values, m->shapes);
    m->highest = values[MODES - 1] * (1.0 + 1e-12);
    /* Jacobi's eigenvalues are good to rounding of the largest */
    m->lowest = fmax(values[0] - 1e-14 * m->highest, 0.0);
    for (int i = 0; i < MODES; ++i)
        m->eta[i] = sqrt(fmax(values[i], 0.0));
    m->narrowest = least_of(modes->d);
    m->widest = largest_of(modes->d);
    m->pump_norm = norm_of(&m->pump_values[0][0], MODES * MODES) * (1.0 + 1e-12);
    m->relative_pump = relative_of(m, values);
    return true;
}
