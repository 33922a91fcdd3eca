/* x' = A x + B u, y = x of two states as an FMI 3.0 co-simulation FMU whose variables are arrays: exact
   steps under a held input, by the Taylor series of the matrix exponential over halves of a step. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "fmi3FunctionTypes.h"
#include "fmi3PlatformTypes.h"

enum { A, B, X0, U, Y, ARRAYS };
static const size_t SIZES[ARRAYS] = {4, 2, 2, 1, 2};
static const double START[ARRAYS][4] = {{-1, 2, -2, -1}, {0, 1}, {0, 0}, {0}, {0, 0}};

typedef struct {
    double reals[ARRAYS][4];
} Model;

static Model *model_new(void) {
    Model *m = malloc(sizeof(Model));
    if (m) memcpy(m->reals, START, sizeof START);
    return m;
}
static void model_free(Model *m) { free(m); }
static int model_reset(Model *m) {
    memcpy(m->reals, START, sizeof START);
    return 0;
}
static void model_begin(Model *m, double start) {}
static void model_initialise(Model *m) { memcpy(m->reals[Y], m->reals[X0], 2 * sizeof(double)); }

/* One Taylor step: x(h) = x + h x' + h^2/2 x'' + ... with x' = A x + B u. */
static void model_step(Model *m, double h) {
    const double *a = m->reals[A], *b = m->reals[B], u = m->reals[U][0];
    double *x = m->reals[Y];
    double term[2] = {a[0] * x[0] + a[1] * x[1] + b[0] * u, a[2] * x[0] + a[3] * x[1] + b[1] * u};
    for (int k = 1; k < 30; k++) {
        double p = term[0] * h / k, q = term[1] * h / k;
        x[0] += p;
        x[1] += q;
        term[0] = a[0] * p + a[1] * q;
        term[1] = a[2] * p + a[3] * q;
    }
}

#define ARRAYS_OF(REFERENCE) SIZES[REFERENCE]
#include "entry3.h"

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 at, fmi3Float64 step, fmi3Boolean no_set,
                      fmi3Boolean *events, fmi3Boolean *terminate, fmi3Boolean *early,
                      fmi3Float64 *reached) {
    *events = *terminate = *early = 0;
    *reached = at + step;
    int parts = 1 + (int)(4.0 * fabs(step));
    for (int k = 0; k < parts; k++) model_step(c, step / parts);
    return fmi3OK;
}

#include "absent3.h"
