#include "duffing_plane.h"

#include <string.h>

/* Eigenvectors are coordinates while the determinant of the normed pair is larger. */
#define INDEPENDENT 0.1

struct precise_matrix {
    struct precise s11, s12, s21, s22;
};

struct matrix matrix_inverse(struct matrix m)
{
    const struct complex determinant =
        c_subtract(c_multiply(m.m11, m.m22), c_multiply(m.m12, m.m21));
    const struct matrix inverse = {
        c_divide(m.m22, determinant),
        c_divide(c_scale(-1.0, m.m12), determinant),
        c_divide(c_scale(-1.0, m.m21), determinant),
        c_divide(m.m11, determinant),
    };
    return inverse;
}

struct matrix matrix_conjugate(struct matrix m)
{
    const struct matrix found = {c_conjugate(m.m11), c_conjugate(m.m12), c_conjugate(m.m21),
                                 c_conjugate(m.m22)};
    return found;
}

struct pair matrix_times(const struct matrix *m, struct pair x)
{
    const struct pair y = {{
        c_add(c_multiply(m->m11, x.z[0]), c_multiply(m->m12, x.z[1])),
        c_add(c_multiply(m->m21, x.z[0]), c_multiply(m->m22, x.z[1])),
    }};
    return y;
}

struct pair plane_turned_gain(const struct plane *plane, struct pair x)
{
    const double *h = plane->gain;
    const struct complex a = c_add(c_scale(h[0], x.z[0]), c_scale(h[1], x.z[1]));
    const struct complex b = c_add(c_scale(h[2], x.z[0]), c_scale(h[3], x.z[1]));
    const struct pair y = {{complex_of(-a.im, a.re), complex_of(-b.im, b.re)}};
    return y;
}

struct pair plane_amplitudes(const struct plane *plane, struct pair w)
{
    const struct pair y = {{
        c_add(w.z[0], c_multiply(plane->mix[0], w.z[1])),
        c_add(c_multiply(plane->mix[1], w.z[0]), w.z[1]),
    }};
    return y;
}

struct pair plane_coordinates(const struct plane *plane, struct pair y)
{
    const struct complex one = complex_of(1.0, 0.0);
    const struct complex scale =
        c_divide(one, c_subtract(one, c_multiply(plane->mix[0], plane->mix[1])));
    const struct pair w = {{
        c_multiply(scale, c_subtract(y.z[0], c_multiply(plane->mix[0], y.z[1]))),
        c_multiply(scale, c_subtract(y.z[1], c_multiply(plane->mix[1], y.z[0]))),
    }};
    return w;
}

/* S over 2 pi, in Hz: S = (e1 + D~)^-1 (e2 - C~), e1 its trace, e2 its determinant. */
static struct precise_matrix solvent_of(const struct parameters *p, const struct pencil *pencil)
{
    const struct damping w = damping_of(p);
    const struct precise e2 = pencil->upper.c[0], minus_e1 = pencil->upper.c[1];
    const struct precise w12 = precise_of(w.w12, 0.0);
    const struct precise a = precise_subtract(precise_of(w.w11, 0.0), minus_e1);
    const struct precise d = precise_subtract(precise_of(w.w22, 0.0), minus_e1);
    const struct precise determinant =
        precise_subtract(precise_multiply(a, d), precise_multiply(w12, w12));
    const struct precise plus = precise_of(p->eta_plus, 0.0), minus = precise_of(p->eta_minus, 0.0);
    const struct precise k1 =
        precise_divide(precise_subtract(e2, precise_multiply(plus, plus)), determinant);
    const struct precise k2 =
        precise_divide(precise_subtract(e2, precise_multiply(minus, minus)), determinant);
    const struct precise_matrix s = {
        precise_multiply(d, k1),
        precise_negate(precise_multiply(w12, k2)),
        precise_negate(precise_multiply(w12, k1)),
        precise_multiply(a, k2),
    };
    return s;
}

static struct real size_of(struct precise z)
{
    return real_add(real_abs(z.re), real_abs(z.im));
}

static struct complex turning(struct precise z)
{
    return c_scale(TWO_PI, precise_complex(z));
}

/* Take the eigenvectors as coordinates where they are far enough apart. */
static void choose_coordinates(const struct pencil *pencil, const struct precise_matrix *s,
                               struct precise frame, struct plane *plane)
{
    struct precise first = pencil->poles[0], second = pencil->poles[1], gap1, gap2;
    struct complex v12, v21, apart;
    plane->rates[0] = turning(precise_subtract(s->s11, frame));
    plane->rates[1] = turning(precise_subtract(s->s22, frame));
    plane->cross[0] = turning(s->s12);
    plane->cross[1] = turning(s->s21);
    memset(plane->mix, 0, sizeof plane->mix);
    if (!real_at_most(size_of(precise_subtract(first, s->s11)),
                      size_of(precise_subtract(second, s->s11)))) {
        first = pencil->poles[1];
        second = pencil->poles[0];
    }
    gap1 = precise_subtract(first, s->s22);
    gap2 = precise_subtract(second, s->s11);
    if (precise_is_zero(gap1) || precise_is_zero(gap2))
        return;
    v12 = precise_complex(precise_divide(s->s12, gap2));
    v21 = precise_complex(precise_divide(s->s21, gap1));
    apart = c_subtract(complex_of(1.0, 0.0), c_multiply(v12, v21));
    if (!(c_abs(apart) > INDEPENDENT))
        return;
    plane->rates[0] = turning(precise_subtract(first, frame));
    plane->rates[1] = turning(precise_subtract(second, frame));
    memset(plane->cross, 0, sizeof plane->cross);
    plane->mix[0] = v12;
    plane->mix[1] = v21;
}

bool plane_of(const struct parameters *p, double centre, struct plane *plane,
              struct report *report)
{
    struct report unheard = {.warnings = 0};
    struct pencil pencil;
    struct precise_matrix s;
    double a, b, c, d, determinant;
    if (!oscillator_pencil(p, &pencil, &unheard))
        return refuse(report,
                      "a mode is overdamped (d1 = %r Hz, d2 = %r Hz at eta_plus = %r Hz, eta_minus "
                      "= %r Hz): the envelope needs oscillating modes; use solver 2 (rk4)",
                      p->d1, p->d2, p->eta_plus, p->eta_minus);
    s = solvent_of(p, &pencil);
    choose_coordinates(&pencil, &s, precise_of(0.0, centre), plane);
    plane->solvent.m11 = turning(s.s11);
    plane->solvent.m12 = turning(s.s12);
    plane->solvent.m21 = turning(s.s21);
    plane->solvent.m22 = turning(s.s22);
    a = 2.0 * plane->solvent.m11.im;
    b = 2.0 * plane->solvent.m12.im;
    c = 2.0 * plane->solvent.m21.im;
    d = 2.0 * plane->solvent.m22.im;
    determinant = a * d - b * c;
    plane->gain[0] = d / determinant;
    plane->gain[1] = -b / determinant;
    plane->gain[2] = -c / determinant;
    plane->gain[3] = a / determinant;
    return true;
}
