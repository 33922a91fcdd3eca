#include "modes_motion.h"

#include <string.h>

/* Angle of the fastest motion over one substep of the Taylor series, and its highest order. */
#define SUBSTEP_ANGLE 2.0
enum { MOST_ORDERS = 60, SQUARINGS = 50 };

/* --- the generator ----------------------------------------------------------------------------- */

static void full_generator(const struct matrices *m, struct generator *made)
{
    made->scaled = true;
    made->scale_power = (int32_t)nearbyint(log2(m->eta[MODES - 1]));
    for (int i = 0; i < MODES; ++i) {
        struct real *row = &made->still[STATES * (MODES + i)];
        made->still[STATES * i + MODES + i] = real_scale(real_of(1.0), made->scale_power);
        row[MODES + i] = real_negate(m->damping[i]);
        for (int j = 0; j < MODES; ++j) {
            row[j] = real_scale(real_negate(m->stiffness[i][j]), -made->scale_power);
            made->pumped[STATES * (MODES + i) + j] =
                real_scale(real_negate(m->pump[i][j]), -made->scale_power);
        }
    }
}

static void turn(struct real *rows, int i, int j, struct real by)
{
    rows[STATES * i + MODES + j] = real_negate(by);
    rows[STATES * (MODES + i) + j] = by;
}

/* z' = 2 pi (i c + i (C - c^2 + i c D + C_p cos psi)/(2 c)) z, in real and imaginary parts. */
static void envelope_generator(const struct matrices *m, double centre, struct generator *made)
{
    const struct real c = real_of(centre), half = real_half(real_reciprocal(c));
    for (int i = 0; i < MODES; ++i) {
        for (int j = 0; j < MODES; ++j) {
            struct real stiffness = m->stiffness[i][j];
            if (i == j)
                stiffness = real_add(stiffness, real_multiply(c, c));
            turn(made->still, i, j, real_multiply(stiffness, half));
            turn(made->pumped, i, j, real_multiply(m->pump[i][j], half));
        }
        made->still[STATES * i + i] = real_negate(real_half(m->damping[i]));
        made->still[STATES * (MODES + i) + MODES + i] = made->still[STATES * i + i];
    }
}

bool generator_of(const struct matrices *m, const struct frame *frame, struct generator *made,
                  struct report *report)
{
    memset(made, 0, sizeof *made);
    if (!frame->rotating) {
        full_generator(m, made);
        return true;
    }
    if (frame->centre == 0.0)
        return refuse(report,
                      "the rotating frame of solver 1 (envelope) needs a drive above 0 Hz; use "
                      "solver 0 (exact) or 2 (rk4)");
    envelope_generator(m, frame->centre, made);
    return true;
}

/* --- Taylor series under a pump ---------------------------------------------------------------- */

static void sparse_of(const struct real *rows, struct sparse *sparse)
{
    memset(sparse, 0, sizeof *sparse);
    for (int i = 0; i < STATES; ++i)
        for (int j = 0; j < STATES; ++j) {
            const struct real x = rows[STATES * i + j];
            if (!x.sign)
                continue;
            sparse->column[i][sparse->count[i]] = j;
            sparse->value[i][sparse->count[i]++] = TWO_PI * real_double(x);
        }
}

static void sparse_apply(const struct sparse *sparse, const double *y, double *result)
{
    for (int i = 0; i < STATES; ++i) {
        result[i] = 0.0;
        for (int k = 0; k < sparse->count[i]; ++k)
            result[i] += sparse->value[i][k] * y[sparse->column[i][k]];
    }
}

void pumped_propagator_make(struct pumped_propagator *flow, const struct generator *made,
                            double pump_hz, double fastest_hz)
{
    sparse_of(made->still, &flow->still);
    sparse_of(made->pumped, &flow->pumped);
    flow->pump_hz = pump_hz;
    flow->substep = SUBSTEP_ANGLE / (TWO_PI * fmax(fastest_hz, pump_hz));
}

static double largest_part(const double *y)
{
    double largest = 0.0;
    for (int i = 0; i < STATES; ++i)
        largest = fmax(largest, fabs(y[i]));
    return largest;
}

/* y after h s: y_(m+1) = h (G y_m + sum_l c_l G_p y_(m-l))/(m + 1). */
static void series(const struct pumped_propagator *flow, double *y, double h, double psi)
{
    const double cosine = cos(psi), sine = sin(psi), angle = TWO_PI * flow->pump_hz * h;
    /* Taylor coefficients of cos(psi + angle s), s from 0 to 1 */
    const double turns[] = {cosine, -sine, -cosine, sine};
    double weights[MOST_ORDERS + 1] = {cosine}, driven[MOST_ORDERS][STATES];
    double term[STATES], rate[STATES], factor = 1.0;
    const double size = largest_part(y);
    int weight_count = 1, small = 0;
    memcpy(term, y, sizeof term);
    for (int m = 0; m < MOST_ORDERS; ++m) {
        const double part = h / (m + 1);
        sparse_apply(&flow->pumped, term, driven[m]);
        sparse_apply(&flow->still, term, rate);
        for (int l = 0; l < weight_count && l <= m; ++l)
            for (int i = 0; i < STATES; ++i)
                rate[i] += weights[l] * driven[m - l][i];
        for (int i = 0; i < STATES; ++i) {
            term[i] = part * rate[i];
            y[i] += term[i];
        }
        /* two in a row: the series of a cosine has every other term alone */
        small = largest_part(term) <= 1e-18 * size ? small + 1 : 0;
        if (small == 2)
            return;
        factor *= angle / (m + 1);
        if (factor > 1e-18)
            weights[weight_count++] = factor * turns[(m + 1) % 4];
    }
}

void pumped_move(const struct pumped_propagator *flow, double *y, double span, double psi)
{
    const double needed = ceil(span / flow->substep), count = needed > 1.0 ? needed : 1.0;
    const double h = span / count;
    for (double k = 0.0; k < count; k += 1.0)
        series(flow, y, h, psi + TWO_PI * flow->pump_hz * (k * h));
}

/* --- Floquet's propagator ----------------------------------------------------------------------- */

void period_table_make(struct period_table *table, const struct pumped_propagator *flow)
{
    const double needed = ceil(1.0 / (flow->pump_hz * flow->substep));
    table->count = needed > 1.0 ? (int32_t)needed : 1;
    table->part = 1.0 / (flow->pump_hz * table->count);
    memset(&table->step[0], 0, sizeof table->step[0]);
    for (int i = 0; i < STATES; ++i)
        table->step[0].x[i][i] = 1.0;
    for (int k = 0; k < table->count; ++k) {
        const double psi = TWO_PI * k / table->count;
        table->step[k + 1] = table->step[k];
        for (int i = 0; i < STATES; ++i)
            pumped_move(flow, table->step[k + 1].x[i], table->part, psi);
    }
    table->power[0] = table->step[table->count];
    table->powers = 1;
}

/* Put the product of a matrix, given by its columns, and a vector in the place of the vector. */
static void combine(const struct columns *columns, double *y)
{
    double moved[STATES];
    for (int i = 0; i < STATES; ++i) {
        moved[i] = 0.0;
        for (int j = 0; j < STATES; ++j)
            moved[i] += columns->x[j][i] * y[j];
    }
    memcpy(y, moved, sizeof moved);
}

void period_table_move(struct period_table *table, const struct pumped_propagator *flow, double *y,
                       uint64_t periods, double fraction)
{
    int place = (int)(fraction * table->count);
    double rest;
    for (int power = 0; power < MOST_POWERS && periods >> power; ++power) {
        if (power == table->powers) {
            table->power[power] = table->power[power - 1];
            for (int i = 0; i < STATES; ++i)
                combine(&table->power[power - 1], table->power[power].x[i]);
            ++table->powers;
        }
        if (periods >> power & 1)
            combine(&table->power[power], y);
    }
    if (place > table->count - 1)
        place = table->count - 1;
    combine(&table->step[place], y);
    rest = (fraction - (double)place / table->count) / flow->pump_hz;
    pumped_move(flow, y, rest, TWO_PI * place / table->count);
}

/* --- stability: see fmu_src/modes_stability.py --------------------------------------------------- */

bool pump_conserves(const struct matrices *m, double pump_hz)
{
    const double t = m->relative_pump, sidebands = floor(sqrt(0.5 * m->lowest) / pump_hz);
    const double middle = 2.0 / t - 2.0;
    double q, r, loss;
    if (sidebands < 1.0 || !(middle > 2.0))
        return false;
    q = 2.0 / (middle + sqrt(middle * middle - 4.0));
    r = 2.0 * t / (2.0 - t * (3.0 + q));
    loss = sidebands * pump_hz * m->narrowest / m->highest;
    return loss > 1.000001 * 0.25 * t * r * pow(q, sidebands - 1.0);
}

double growth_of(const struct period_table *table)
{
    struct columns matrix = table->step[table->count];
    double logarithm = 0.0, power = 1.0;
    for (int k = 0; k < SQUARINGS; ++k) {
        const double size = norm_of(&matrix.x[0][0], STATES * STATES);
        struct columns squared;
        logarithm += log(size);
        if (logarithm < 0.0)
            break; /* a power of norm below 1 is the proof */
        for (int i = 0; i < STATES; ++i)
            for (int j = 0; j < STATES; ++j)
                matrix.x[i][j] /= size;
        squared = matrix;
        for (int i = 0; i < STATES; ++i)
            combine(&matrix, squared.x[i]);
        matrix = squared;
        logarithm *= 2.0;
        power *= 2.0;
    }
    return exp(logarithm / power);
}
