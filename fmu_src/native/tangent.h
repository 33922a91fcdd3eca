/* Directional derivatives of linear modes under two tones, in closed form and 192 bits: what a
 * small change of the equations, the drive or the input does to steady state and displacements.
 *
 * The transient and its change are one linear system, [G 0; dG G], whose exponential is applied; the
 * change counts from where the present stretch of the run began, whose state is kept. */
#ifndef TANGENT_H
#define TANGENT_H

#include "precise.h"
#include "propagator.h"

enum { MOST_MODES = MOST_STATES / 4 };

/* x'' + D x' + C x = g (two tones + b), all over (2 pi)^2, matrices row by row; rotating: the
 * envelope's equations in a frame at centre. A change of it is a record of the same form. */
struct linear_system {
    int32_t modes;
    bool rotating;
    struct real stiffness[MOST_MODES * MOST_MODES], damping[MOST_MODES * MOST_MODES];
    struct real g[MOST_MODES];
    double centre, u[2], size[2], phase[2], b;
};

/* Displacements and velocities over 2 pi (rotating: real and imaginary parts) where the present
 * stretch began; turn: the tones' cycles there, without their phases. A change of a frequency turns
 * the phase from ``since`` on. */
struct stretch {
    bool in_motion; /* not on the periodic orbit */
    double begin, since;
    struct real state[2 * MOST_MODES];
    double cycles[2];
};

/* Response to a unit tone at place 0 or 1, over (2 pi)^2, and its change; false where there is
 * none. */
bool response_tangent(const struct linear_system *system, const struct linear_system *change,
                      int place, struct precise *x, struct precise *dx);
/* Change of A exp(i phase) times the response to a tone, in m. */
bool phasor_tangent(const struct linear_system *system, const struct linear_system *change,
                    int place, struct complex *dz);
/* Change of displacements at t, where the tones have turned by so many cycles; room: for the work. */
bool displacement_tangent(const struct linear_system *system, const struct linear_system *change,
                          const struct stretch *stretch, double t, const double cycles[2],
                          struct propagator *room, double *dq);

#endif
