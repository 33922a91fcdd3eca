#include "tangent.h"

#include <string.h>

/* A number and its change. */
struct dual {
    struct precise value, change;
};

static struct precise real_part(struct real x)
{
    const struct precise z = {x, real_of(0.0)};
    return z;
}

static struct dual dual_of(double value, double change)
{
    const struct dual z = {precise_of(value, 0.0), precise_of(change, 0.0)};
    return z;
}

static struct dual dual_add(struct dual a, struct dual b)
{
    const struct dual z = {precise_add(a.value, b.value), precise_add(a.change, b.change)};
    return z;
}

static struct dual dual_subtract(struct dual a, struct dual b)
{
    const struct dual z = {precise_subtract(a.value, b.value),
                           precise_subtract(a.change, b.change)};
    return z;
}

static struct dual dual_multiply(struct dual a, struct dual b)
{
    const struct dual z = {
        precise_multiply(a.value, b.value),
        precise_add(precise_multiply(a.value, b.change), precise_multiply(a.change, b.value)),
    };
    return z;
}

static struct dual times_i(struct dual a)
{
    struct dual z;
    z.value.re = real_negate(a.value.im);
    z.value.im = a.value.re;
    z.change.re = real_negate(a.change.im);
    z.change.im = a.change.re;
    return z;
}

/* --- the periodic part -------------------------------------------------------------------------- */

/* A(v) of the full equations or the envelope's, and its change. */
static void write_block(const struct linear_system *system, const struct linear_system *change,
                        struct dual v, struct dual *block)
{
    const int n = system->modes;
    const struct dual c = dual_of(system->centre, change->centre);
    const struct dual square =
        system->rotating ? dual_multiply(c, dual_subtract(dual_add(v, v), c))
                         : dual_multiply(v, v);
    const struct dual carrier = times_i(system->rotating ? c : v);
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
            const int at = n * i + j;
            const struct dual stiffness = {real_part(system->stiffness[at]),
                                           real_part(change->stiffness[at])};
            const struct dual damping = {real_part(system->damping[at]),
                                         real_part(change->damping[at])};
            block[at] = dual_add(stiffness, dual_multiply(carrier, damping));
            if (i == j)
                block[at] = dual_subtract(block[at], square);
        }
}

/* A X = g, and A dX = dg - dA X. */
static bool solve(const struct linear_system *system, const struct linear_system *change,
                  struct dual v, struct dual *x)
{
    const int n = system->modes;
    struct dual block[MOST_MODES * MOST_MODES];
    struct precise rows[MOST_MODES * MOST_MODES], right[MOST_MODES];
    write_block(system, change, v, block);
    for (int part = 0; part < 2; ++part) {
        for (int i = 0; i < n; ++i) {
            right[i] = real_part(part ? change->g[i] : system->g[i]);
            for (int j = 0; j < n; ++j) {
                rows[n * i + j] = block[n * i + j].value;
                if (part)
                    right[i] = precise_subtract(
                        right[i], precise_multiply(block[n * i + j].change, x[j].value));
            }
        }
        if (!precise_solve(rows, right, n))
            return false;
        for (int i = 0; i < n; ++i)
            *(part ? &x[i].change : &x[i].value) = right[i];
    }
    return true;
}

bool response_tangent(const struct linear_system *system, const struct linear_system *change,
                      int place, struct precise *x, struct precise *dx)
{
    struct dual found[MOST_MODES];
    if (!solve(system, change, dual_of(system->u[place], change->u[place]), found))
        return false;
    for (int i = 0; i < system->modes; ++i) {
        x[i] = found[i].value;
        dx[i] = found[i].change;
    }
    return true;
}

/* A exp(i phase) X/(2 pi)^2; nothing for a tone that neither is nor comes to be. */
static bool phasors_of(const struct linear_system *system, const struct linear_system *change,
                       int place, struct dual *z)
{
    const double size = system->size[place], more = change->size[place];
    const struct precise turn = precise_of_complex(c_rect(1.0, system->phase[place]));
    const struct precise factor = {
        real_reciprocal(real_multiply(REAL_TWO_PI, REAL_TWO_PI)), real_of(0.0)};
    struct dual amplitude = dual_of(size, more);
    memset(z, 0, (size_t)system->modes * sizeof *z);
    if (size == 0.0 && more == 0.0)
        return true;
    if (!solve(system, change, dual_of(system->u[place], change->u[place]), z))
        return false;
    amplitude.change.im = real_multiply(real_of(size), real_of(change->phase[place]));
    amplitude.value = precise_multiply(amplitude.value, precise_multiply(turn, factor));
    amplitude.change = precise_multiply(amplitude.change, precise_multiply(turn, factor));
    for (int i = 0; i < system->modes; ++i)
        z[i] = dual_multiply(amplitude, z[i]);
    return true;
}

bool phasor_tangent(const struct linear_system *system, const struct linear_system *change,
                    int place, struct complex *dz)
{
    struct dual z[MOST_MODES];
    if (!phasors_of(system, change, place, z))
        return false;
    for (int i = 0; i < system->modes; ++i)
        dz[i] = precise_complex(z[i].change);
    return true;
}

/* Add the real parts of a tone's motion where it has turned, then those of its velocity over 2 pi
 * (rotating: its imaginary parts): values first, changes after them. */
static void add_motion(const struct linear_system *system, const struct dual *z, struct dual u,
                       struct dual turn, struct real *y)
{
    const int n = system->modes;
    for (int i = 0; i < n; ++i) {
        const struct dual x = dual_multiply(z[i], turn);
        const struct dual w = times_i(dual_multiply(u, x));
        y[i] = real_add(y[i], x.value.re);
        y[n + i] = real_add(y[n + i], system->rotating ? x.value.im : w.value.re);
        y[2 * n + i] = real_add(y[2 * n + i], x.change.re);
        y[3 * n + i] = real_add(y[3 * n + i], system->rotating ? x.change.im : w.change.re);
    }
}

/* Add the displacements that the input holds. */
static bool add_held(const struct linear_system *system, const struct linear_system *change,
                     struct real *y)
{
    const struct precise over = {
        real_reciprocal(real_multiply(REAL_TWO_PI, REAL_TWO_PI)), real_of(0.0)};
    struct dual x[MOST_MODES], b = dual_of(system->b, change->b);
    if (system->rotating || (system->b == 0.0 && change->b == 0.0))
        return true;
    if (!solve(system, change, dual_of(0.0, 0.0), x))
        return false;
    b.value = precise_multiply(b.value, over);
    b.change = precise_multiply(b.change, over);
    for (int i = 0; i < system->modes; ++i) {
        const struct dual held = dual_multiply(b, x[i]);
        y[i] = real_add(y[i], held.value.re);
        y[2 * system->modes + i] = real_add(y[2 * system->modes + i], held.change.re);
    }
    return true;
}

/* A turn and its change, where a change of the frequency has turned it for some time. */
static struct dual turn_of(struct precise turn, double du, double t, double since)
{
    const struct real time = real_subtract(real_of(t), real_of(since));
    const struct real angle = real_multiply(REAL_TWO_PI, real_multiply(real_of(du), time));
    struct dual z = {turn, turn};
    z.change.re = real_negate(real_multiply(angle, turn.im));
    z.change.im = real_multiply(angle, turn.re);
    return z;
}

/* --- the transient ------------------------------------------------------------------------------ */

/* G and its change of y = (x, x'/(2 pi)), or of the envelope's (Re z, Im z), as [G 0; dG G]. */
static void write_generator(const struct linear_system *system,
                            const struct linear_system *change, struct real *rows)
{
    const int n = system->modes, size = 4 * n;
    const struct real c = real_of(system->centre), dc = real_of(change->centre);
    const struct real over = system->rotating ? real_half(real_reciprocal(c)) : c;
    memset(rows, 0, (size_t)(size * size) * sizeof *rows);
    for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) {
            const struct real k = system->stiffness[n * i + j], dk = change->stiffness[n * i + j];
            const struct real d = system->damping[n * i + j], dd = change->damping[n * i + j];
            for (int block = 0; block < 2; ++block) { /* 0: G, 1: dG */
                struct real *first = &rows[size * (2 * n * block + i)];
                struct real *second = &rows[size * (2 * n * block + n + i)];
                const struct real damped = real_negate(block ? dd : d);
                struct real turn;
                if (!system->rotating) {
                    first[n + i] = real_of(block ? 0.0 : 1.0);
                    second[j] = real_negate(block ? dk : k);
                    second[n + j] = damped;
                    continue;
                }
                /* (C + c^2)/(2 c), whose change is (dC + 2 c dc)/(2 c) - (C + c^2) dc/(2 c^2) */
                turn = i == j ? real_add(k, real_multiply(c, c)) : k;
                turn = real_multiply(turn, over);
                if (block) {
                    const struct real own =
                        i == j ? real_multiply(real_add(c, c), dc) : real_of(0.0);
                    const struct real less =
                        real_multiply(turn, real_multiply(dc, real_add(over, over)));
                    turn = real_subtract(real_multiply(real_add(dk, own), over), less);
                }
                first[j] = second[n + j] = real_half(damped);
                first[n + j] = real_negate(turn);
                second[j] = turn;
            }
        }
    for (int i = 0; i < 2 * n; ++i)
        for (int j = 0; j < 2 * n; ++j)
            rows[size * (2 * n + i) + 2 * n + j] = rows[size * i + j];
}

/* The turn after some time, in all digits. */
static struct precise turned(struct precise turn, double u, struct real dt,
                             struct propagator *room)
{
    const struct real zero = real_of(0.0), speed = real_of(u);
    const struct real rows[] = {zero, real_negate(speed), speed, zero};
    struct real parts[] = {turn.re, turn.im};
    propagator_make(room, rows, 2);
    propagator_move(room, parts, dt);
    turn.re = parts[0];
    turn.im = parts[1];
    return turn;
}

/* Velocities are over 2 pi F in the transient, F near the eigenfrequencies: a power of 2. */
static int32_t power_of(const struct linear_system *system)
{
    int32_t power = 0;
    for (int i = 0; i < system->modes && !system->rotating; ++i) {
        const int32_t half = system->stiffness[(system->modes + 1) * i].exponent / 2;
        power = i == 0 || half > power ? half : power;
    }
    return power;
}

static void rescale(int n, struct real *y, int32_t power)
{
    for (int i = 0; i < n; ++i) {
        y[n + i] = real_scale(y[n + i], power);
        y[3 * n + i] = real_scale(y[3 * n + i], power);
    }
}

/* Put the transient and its change some time later in the place of both. */
static void move_free(const struct linear_system *system, const struct linear_system *change,
                      struct real dt, struct propagator *room, struct real *free)
{
    const int n = system->modes, size = 4 * n;
    const int32_t power = power_of(system);
    struct real rows[MOST_STATES * MOST_STATES];
    write_generator(system, change, rows);
    for (int i = 0; i < size; ++i)
        for (int j = 0; j < size; ++j) {
            const int from = j / n % 2, to = i / n % 2;
            rows[size * i + j] = real_scale(rows[size * i + j], power * (from - to));
        }
    propagator_make(room, rows, size);
    rescale(n, free, -power);
    propagator_move(room, free, dt);
    rescale(n, free, power);
}

bool displacement_tangent(const struct linear_system *system, const struct linear_system *change,
                          const struct stretch *stretch, double t, const double cycles[2],
                          struct propagator *room, double *dq)
{
    const int n = system->modes;
    const struct real dt = real_subtract(real_of(t), real_of(stretch->begin));
    struct real before[MOST_STATES], now[MOST_STATES], free[MOST_STATES];
    memset(before, 0, sizeof before);
    memset(now, 0, sizeof now);
    if (!add_held(system, change, before) || !add_held(system, change, now))
        return false;
    for (int i = 0; i < 2; ++i) {
        const struct dual u = dual_of(system->u[i], change->u[i]);
        const double *turns = stretch->in_motion ? stretch->cycles : cycles;
        const struct precise begun = precise_of_complex(c_rect(1.0, TWO_PI * turns[i]));
        struct precise turn = begun;
        struct dual z[MOST_MODES];
        if (!phasors_of(system, change, i, z))
            return false;
        if (stretch->in_motion)
            turn = turned(begun, system->u[i], dt, room);
        add_motion(system, z, u, turn_of(begun, change->u[i], stretch->begin, stretch->since),
                   before);
        add_motion(system, z, u, turn_of(turn, change->u[i], t, stretch->since), now);
    }
    memset(free, 0, sizeof free);
    if (stretch->in_motion) {
        for (int i = 0; i < 4 * n; ++i) /* the state is kept, its change is 0 */
            free[i] = real_subtract(i < 2 * n ? stretch->state[i] : real_of(0.0), before[i]);
        move_free(system, change, dt, room, free);
    }
    for (int i = 0; i < n; ++i)
        dq[i] = real_double(real_add(free[2 * n + i], now[2 * n + i]));
    return true;
}
