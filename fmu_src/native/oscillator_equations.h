/* The coupled oscillator in SI units: closed forms. See fmu_src/oscillator_equations.py. */
#ifndef OSCILLATOR_EQUATIONS_H
#define OSCILLATOR_EQUATIONS_H

#include "complex_number.h"
#include "sentence.h"

/* Angles in rad, all frequencies and damping coefficients in Hz. */
struct parameters {
    double theta;
    bool reflection;
    double d1, d2, eta_plus, eta_minus, u1, u2, A1, A2, phase1, phase2, g1, g2;
};

/* One value for each mode. */
struct pair {
    struct complex z[2];
};

/* T of q~ = T q, for either form of O(2). */
struct transformation {
    double t11, t12, t21, t22;
};

/* D~ / 2 pi in Hz: the line widths of the modes. */
struct damping {
    double w11, w22, w12;
};

struct coupling {
    double lambda, f1, f2;
};

struct transformation transformation_of(double theta, bool reflection);
struct damping damping_of(const struct parameters *p);
struct coupling coupling_of(const struct parameters *p);
/* The steady state of unit amplitude at u, of the full equations and in a frame at centre. */
bool phasors(const struct parameters *p, double u, struct pair *x, struct report *report);
bool rotating_phasors(const struct parameters *p, double u, double centre, struct pair *x,
                      struct report *report);
/* The frequency of the rotating frame: the mean of the active tones, or of the modes. */
double centre_of(const struct parameters *p);
void physical_displacements(const struct parameters *p, const double q[2], double physical[2]);
bool check_parameters(const struct parameters *p, bool periodic_start, struct report *report);

#endif
