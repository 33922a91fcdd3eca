/* The slow model of the Duffing oscillator: averaging to second order around an exact linear part.
 * The derivation is in fmu_src/duffing_slow.py. */
#ifndef DUFFING_SLOW_H
#define DUFFING_SLOW_H

#include "duffing_equations.h"
#include "duffing_plane.h"
#include "oscillator_linear.h"

/* A drive tone: detuning from the frame, cycles added, the responses with amplitude, and the
 * conjugate of what its counter-rotating half does to Z. */
struct slow_tone {
    struct frequency detuning;
    double offset;
    struct pair response, mirror;
};

/* The tones' phases in the frame, as complex numbers of size 1. */
struct turns {
    struct complex z[2];
};

struct slow_model {
    struct parameters p;
    struct cubic cubic;
    double centre;
    int32_t tones;
    struct slow_tone tone[2];
    struct frequency carrier;
    struct plane plane;
    int32_t lone; /* the mode with the only cubic term, -1 where modes move each other */
    double spread; /* of two tones' frequencies, relative to the frame's */
    struct matrix behind, behind3, third; /* responses to cubic forces away from the carrier */
};

/* The mean of the active tones' frequencies, or the mode nearest to u1, in Hz. */
double frame_frequency(const struct parameters *p);
bool slow_prepare(struct slow_model *model, const struct parameters *p, const struct cubic *cubic,
                  const double offsets[2], struct report *report);
struct turns slow_turns(const struct slow_model *model, double t);
/* What turns are multiplied by in a time. */
struct turns slow_onwards(const struct slow_model *model, double h);
struct pair slow_turned(const struct slow_model *model, const struct turns *turns);
/* Slow amplitudes of the linear periodic response. */
struct pair slow_linear(const struct slow_model *model, double t);
/* Q from w, and back. */
struct pair slow_amplitudes(const struct slow_model *model, struct pair w, struct pair linear);
struct pair slow_deviation(const struct slow_model *model, struct pair q, struct pair linear);
/* w' less the part with the plane's rates, and Q; a slope_function. */
void slow_slope(const void *model, const struct pair *w, const struct pair *linear,
                struct pair *n, struct pair *q);
/* The bound of what averaging leaves out of a displacement's largest line, relative to it. */
double slow_averaging_error(const struct slow_model *model, struct pair w, double t, double eps);
void slow_displacement(const struct slow_model *model, struct pair q, double t, double found[2]);
/* Displacements and velocities over 2 pi from w, and back. */
struct state slow_full_state(const struct slow_model *model, struct pair w, double t);
struct pair slow_from_state(const struct slow_model *model, const struct state *state, double t);

#endif
