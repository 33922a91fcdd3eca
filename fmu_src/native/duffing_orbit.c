#include "duffing_orbit.h"

struct pair averaged_orbit(const struct slow_model *model, struct pair linear, bool upper)
{
    const struct parameters *p = &model->p;
    const struct damping w = damping_of(p);
    const double omega = TWO_PI * model->centre, kappa = model->cubic.kappa;
    const double alpha[] = {model->cubic.alpha1, model->cubic.alpha2};
    const double eta[] = {p->eta_plus, p->eta_minus}, width[] = {w.w11, w.w22};
    const struct complex cross = complex_of(0.0, omega * TWO_PI * w.w12);
    struct pair q = {{{0.0, 0.0}, {0.0, 0.0}}}, drive;
    double loss[2], detuning[2];
    for (int i = 0; i < 2; ++i) {
        loss[i] = omega * TWO_PI * width[i];
        detuning[i] = TWO_PI * (eta[i] - model->centre) * TWO_PI * (eta[i] + model->centre);
    }
    for (int i = 0; i < 2; ++i)
        drive.z[i] = c_add(c_multiply(complex_of(detuning[i], loss[i]), linear.z[i]),
                           c_multiply(cross, linear.z[1 - i]));
    for (int round = 0; round < 40; ++round) {
        const struct pair before = q;
        for (int i = 0; i < 2; ++i) {
            const struct complex other = q.z[1 - i];
            const double size = c_abs(other), lifted = detuning[i] + 0.5 * kappa * (size * size);
            const struct complex turned =
                c_multiply(c_multiply(c_scale(0.25 * kappa, c_conjugate(q.z[i])), other), other);
            const struct complex force =
                c_subtract(c_subtract(drive.z[i], c_multiply(cross, other)), turned);
            const struct squares found = steady_squares(lifted, loss[i], alpha[i], c_abs(force));
            const double square = upper ? found.high : found.low;
            q.z[i] = c_divide(force, complex_of(lifted + 0.75 * alpha[i] * square, loss[i]));
        }
        if (c_is_zero(c_subtract(q.z[0], before.z[0])) &&
            c_is_zero(c_subtract(q.z[1], before.z[1])))
            break;
    }
    return q;
}

/* What stands still where the slow motion does. */
struct standing {
    const struct slow_model *model;
    struct pair linear;
};

static bool slow_motion(const void *context, const double x[UNKNOWNS], double value[UNKNOWNS],
                        struct report *report)
{
    const struct standing *at = context;
    const struct pair w = {{{x[0], x[1]}, {x[2], x[3]}}};
    struct pair n, q;
    (void)report;
    slow_slope(at->model, &w, &at->linear, &n, &q);
    for (int i = 0; i < 2; ++i) {
        const struct complex v = c_add(c_multiply(at->model->plane.rates[i], w.z[i]), n.z[i]);
        value[2 * i] = v.re;
        value[2 * i + 1] = v.im;
    }
    return true;
}

bool fixed_point(const struct slow_model *model, struct pair linear, struct pair *w, bool *found,
                 struct report *report)
{
    const struct standing at = {model, linear};
    struct root_problem problem = {.function = slow_motion, .context = &at};
    double x[UNKNOWNS] = {w->z[0].re, w->z[0].im, w->z[1].re, w->z[1].im}, size[2];
    for (int i = 0; i < 2; ++i)
        size[i] = c_abs(w->z[i]) + c_abs(linear.z[i]);
    for (int i = 0; i < UNKNOWNS; ++i)
        problem.scales[i] = fmax(size[i / 2], 1e-9 * fmax(size[0], size[1]));
    if (!find_root(&problem, x, found, report))
        return false;
    for (int i = 0; i < 2 && *found; ++i)
        w->z[i] = complex_of(x[2 * i], x[2 * i + 1]);
    return true;
}
