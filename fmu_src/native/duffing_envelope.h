/* The solver "envelope" of the Duffing oscillator: slow amplitudes in a rotating frame. */
#ifndef DUFFING_ENVELOPE_H
#define DUFFING_ENVELOPE_H

#include "duffing_exponential.h"
#include "duffing_slow.h"

/* The relative frequency shift by the cubic terms beyond which an expansion says nothing. */
#define LARGEST_SHIFT 0.1

/* One period of a settled two-tone motion, of which all later ones are copies: where it begins, and
 * how. Its steps are taken anew where a later time asks for an earlier one's like. */
struct period {
    bool known;
    int32_t steps;
    double begin, length, next, scale[2];
    struct pair w;
};

struct envelope_solver {
    struct slow_model model;
    struct period period;
    double settling, decay; /* until when it settles, and how fast what it misses is forgotten */
    double offsets[2], tolerance, longest, next, scale[2];
    bool upper, stepped, weighed;
    double weighed_step; /* the step that the weights are for */
    struct weights weights[2];
    struct turns to_probe, to_middle; /* how far the tones turn in parts of that step */
    struct step step;      /* the last one, if stepped */
    double t;              /* what it reached: time, w and the slope there */
    struct pair w, n;
};

/* What a solver is made of beside the parameters. */
struct envelope_settings {
    struct cubic cubic;
    double tolerance;
    bool upper;
};

bool envelope_prepare(struct envelope_solver *solver, const struct parameters *p,
                      const struct envelope_settings *settings, const double offsets[2],
                      struct report *report);
bool envelope_start(struct envelope_solver *solver, double t, const struct state *state, double b,
                    struct report *report);
bool envelope_refuse_input(double b, struct report *report);
bool envelope_advance(struct envelope_solver *solver, double t, struct report *report);
/* Q at a time within the last step. */
struct pair envelope_amplitudes(const struct envelope_solver *solver, double t);
/* The bound of what averaging leaves out at a time, where the relative frequency shift is eps. */
double envelope_averaging_error(const struct envelope_solver *solver, double t, double eps);
struct state envelope_state(const struct envelope_solver *solver, double t);

#endif
