/* The solvers "exact" and "envelope" of N modes: periodic part by sidebands, plus a transient.
 *
 * What a run needs is small and stored with the state of the FMU (struct run). What follows from the
 * parameters alone is large, kept beside it (struct scratch), and made again where it is that of
 * other parameters. */
#ifndef MODES_LINEAR_H
#define MODES_LINEAR_H

#include "modes_motion.h"
#include "phase.h"

enum { HELD = 2, RESPONSES = 3 };

/* Displacements and velocities over 2 pi (envelope: real and imaginary parts). */
struct state {
    struct real y[STATES];
};

/* The transient of unpumped modes, as the generator has it, and the turning of the drive; when it
 * began, and the whole state then, which derivatives go out from. */
struct exact_motion {
    struct real free[STATES], first;
    struct precise turn[2];
    double begun_at;
    struct state begun;
};

/* The transient of pumped modes: now, and where a pump period began. */
struct pumped_motion {
    double free[STATES], first;
    bool has_begun;
    double begun_at, begun[STATES];
};

struct run {
    struct parameters p;
    bool envelope, in_motion; /* in_motion: not on the periodic orbit */
    double offsets[3];        /* cycles added to the tones and the pump by retuning */
    double b, t;              /* t: of the transient */
    double since;             /* where changed frequencies begin to turn the phase: see tangent.h */
    union {
        struct exact_motion exact;
        struct pumped_motion pumped;
    };
};

/* The lines of a tone of its amplitude: z_k, and whether it is more than rounding. */
struct lines {
    bool made;
    double u;
    struct frequency frequency;
    struct vector z[CHAIN_LENGTH];
    bool kept[CHAIN_LENGTH];
};

struct scratch {
    bool made; /* nothing below holds before */
    struct parameters p;
    bool envelope;
    struct frame frame;
    double fastest_hz;
    struct matrices matrices;
    bool has_flow, has_table, has_response[RESPONSES + 1], has_turning[2];
    struct generator generator;
    struct propagator flow, turning[2];
    struct pumped_propagator pumped_flow;
    struct period_table table;
    struct chain chain;
    struct steady response[RESPONSES + 1]; /* of both tones, of a held input; of the full equations */
    struct lines lines[2], held;
    struct precise_vector driven[2]; /* responses times amplitudes */
    struct propagator room;          /* in which derivatives are calculated */
};

/* Make the scratch for these parameters, if it is that of others. */
bool scratch_make(struct scratch *scratch, const struct parameters *p, bool envelope,
                  struct report *report);
/* The response at tone 0 or 1, or at 0 Hz (HELD); NULL where it is refused. */
const struct steady *response_of(struct scratch *scratch, int place, struct report *report);
/* The same of the full equations. */
const struct steady *full_response_of(struct scratch *scratch, int place, struct report *report);

/* Begin at t from a state (NULL: on the periodic orbit). */
bool run_start(struct run *run, struct scratch *scratch, double t, const struct state *state,
               double b, struct report *report);
bool run_advance(struct run *run, struct scratch *scratch, double t, struct report *report);
bool run_displacement(const struct run *run, struct scratch *scratch, double t, double *q,
                      struct report *report);
bool run_state(const struct run *run, struct scratch *scratch, double t, struct state *state,
               struct report *report);
bool run_with_input(struct run *run, struct scratch *scratch, double b, double t,
                    struct report *report);
/* z and z'/(2 pi) of the analytic signals whose real parts are the periodic part. */
bool orbit_at(const struct run *run, struct scratch *scratch, double t, double b,
              struct complex z[STATES], struct report *report);
double pump_cycles(const struct run *run, double t);

#endif
