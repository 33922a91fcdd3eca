#include "duffing_equations.h"

#include <math.h>
#include <string.h>

#include "complex_number.h"

/* A root is found where Newton's step is this small beside the unknowns, or where it is below the
 * second and no longer a tenth of the one before: that is rounding. */
#define SETTLED 1e-12
#define ROUNDED 1e-8

bool any_cubic(const struct cubic *cubic)
{
    return cubic->alpha1 != 0.0 || cubic->alpha2 != 0.0 || cubic->kappa != 0.0;
}

bool check_cubic(const struct cubic *cubic, struct report *report)
{
    const char *const names[] = {"alpha1", "alpha2", "kappa"};
    const double values[] = {cubic->alpha1, cubic->alpha2, cubic->kappa};
    for (int i = 0; i < 3; ++i)
        if (!isfinite(values[i]))
            return refuse(report, "%s = %r is not a finite number", names[i], values[i]);
    return true;
}

double cubic_shift(const struct cubic *cubic, const double squares[2], double centre)
{
    const double alpha1 = fabs(cubic->alpha1), alpha2 = fabs(cubic->alpha2);
    const double kappa = fabs(cubic->kappa), omega = 2.0 * PI * centre;
    if (!any_cubic(cubic))
        return 0.0;
    return 0.375 *
           fmax(alpha1 * squares[0] + kappa * squares[1], alpha2 * squares[1] + kappa * squares[0]) /
           (omega * omega);
}

/* x ((s + x)^2 + 1) - power, which rises but between two turns. */
struct excess {
    double s, power;
};

static double excess_at(struct excess e, double x)
{
    return x * ((e.s + x) * (e.s + x) + 1.0) - e.power;
}

/* The root between two numbers, to the last digits. */
static double bisect(struct excess e, double low, double high)
{
    for (int i = 0; i < 200; ++i) {
        const double middle = 0.5 * (low + high);
        if (!(low < middle && middle < high))
            break;
        if (excess_at(e, middle) < 0.0)
            low = middle;
        else
            high = middle;
    }
    return 0.5 * (low + high);
}

struct squares steady_squares(double detuning, double damping, double alpha, double drive)
{
    const double linear = drive == 0.0 ? 0.0 : drive / hypot(detuning, damping);
    struct squares found = {linear * linear, linear * linear};
    /* x = 3/4 |alpha| |a|^2/damping */
    const double s = copysign(1.0, alpha) * detuning / damping, part = drive / damping;
    const struct excess e = {s, 0.75 * fabs(alpha) / damping * (part * part)};
    const double unit = damping / (0.75 * fabs(alpha));
    const double limit = e.power + 2.0 * fabs(s) + 1.0; /* the excess is positive there */
    const bool turns = s < -sqrt(3.0);
    const double outer = turns ? (-2.0 * s + sqrt(s * s - 3.0)) / 3.0 : 0.0;
    const double inner = turns ? (s * s + 1.0) / (3.0 * outer) : 0.0; /* their product is known */
    if (drive == 0.0 || alpha == 0.0)
        return found;
    if (!turns || excess_at(e, inner) < 0.0) { /* beyond the first turn */
        found.low = found.high = bisect(e, outer, limit);
    } else {
        found.low = bisect(e, 0.0, inner);
        found.high = excess_at(e, outer) > 0.0 ? found.low : bisect(e, outer, limit);
    }
    found.low *= unit;
    found.high *= unit;
    return found;
}

/* Gaussian elimination with row pivoting, in place; the sign of the determinant, 0 where singular. */
static double solve(double rows[UNKNOWNS][UNKNOWNS + 1], double x[UNKNOWNS])
{
    double sign = 1.0;
    for (int i = 0; i < UNKNOWNS; ++i) {
        int pivot = i;
        for (int k = i + 1; k < UNKNOWNS; ++k)
            if (fabs(rows[k][i]) > fabs(rows[pivot][i]))
                pivot = k;
        if (!(fabs(rows[pivot][i]) > 0.0))
            return 0.0;
        if (pivot != i) {
            double kept[UNKNOWNS + 1];
            memcpy(kept, rows[i], sizeof kept);
            memcpy(rows[i], rows[pivot], sizeof kept);
            memcpy(rows[pivot], kept, sizeof kept);
            sign = -sign;
        }
        sign = copysign(sign, sign * rows[i][i]);
        for (int k = i + 1; k < UNKNOWNS; ++k) {
            const double factor = rows[k][i] / rows[i][i];
            for (int j = i; j <= UNKNOWNS; ++j)
                rows[k][j] -= factor * rows[i][j];
        }
    }
    for (int i = UNKNOWNS - 1; i >= 0; --i) {
        double rest = 0.0;
        for (int j = i + 1; j < UNKNOWNS; ++j)
            rest += rows[i][j] * x[j];
        x[i] = (rows[i][UNKNOWNS] - rest) / rows[i][i];
    }
    return sign;
}

/* The Jacobian by central differences, beside the function itself. */
static bool linearise(const struct root_problem *problem, const double x[UNKNOWNS],
                      double rows[UNKNOWNS][UNKNOWNS + 1], struct report *report)
{
    double here[UNKNOWNS], above[UNKNOWNS], below[UNKNOWNS];
    if (!problem->function(problem->context, x, here, report))
        return false;
    for (int i = 0; i < UNKNOWNS; ++i) {
        const double step = 1e-5 * problem->scales[i];
        double ahead[UNKNOWNS], behind[UNKNOWNS], width;
        memcpy(ahead, x, sizeof ahead);
        memcpy(behind, x, sizeof behind);
        ahead[i] += step;
        behind[i] -= step;
        width = ahead[i] - behind[i];
        if (!problem->function(problem->context, ahead, above, report) ||
            !problem->function(problem->context, behind, below, report))
            return false;
        for (int k = 0; k < UNKNOWNS; ++k)
            rows[k][i] = (above[k] - below[k]) / width;
    }
    for (int k = 0; k < UNKNOWNS; ++k)
        rows[k][UNKNOWNS] = here[k];
    return true;
}

/* A zero with a negative determinant counts as none: it is the saddle between two stable orbits. */
bool find_root(const struct root_problem *problem, double x[UNKNOWNS], bool *found,
               struct report *report)
{
    double before = INFINITY;
    *found = false;
    for (int round = 0; round < 30; ++round) {
        double rows[UNKNOWNS][UNKNOWNS + 1], change[UNKNOWNS], size = 0.0, sign;
        if (!linearise(problem, x, rows, report))
            return false;
        sign = solve(rows, change);
        if (sign == 0.0)
            return refuse(report, "the equations of the periodic orbit are singular");
        for (int i = 0; i < UNKNOWNS; ++i) {
            x[i] -= change[i];
            size = fmax(size, fabs(change[i]) / problem->scales[i]);
        }
        if (!(size < 1e3))
            return true;
        if (size < SETTLED || (0.1 * before < size && size < ROUNDED)) {
            *found = sign > 0.0;
            return true;
        }
        before = size;
    }
    return true;
}
