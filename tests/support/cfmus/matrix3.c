/* x' = A x + B u, y = x of two states as an FMI 3.0 co-simulation FMU whose variables are arrays: exact
   steps under a held input, by the Taylor series of the matrix exponential over halves of a step. How many
   terms that has is a structural parameter, which is set in configuration mode alone. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "fmi3FunctionTypes.h"
#include "fmi3PlatformTypes.h"

enum { A, B, X0, U, Y, ARRAYS, TERMS = 5 };
static const size_t SIZES[ARRAYS] = {4, 2, 2, 1, 2};
static const double START[ARRAYS][4] = {{-1, 2, -2, -1}, {0, 1}, {0, 0}, {0}, {0, 0}};

typedef struct {
    double reals[ARRAYS][4];
    fmi3UInt64 terms;
    int configuring;
} Model;

static Model *model_new(void) {
    Model *m = malloc(sizeof(Model));
    if (m) memcpy(m->reals, START, sizeof START), m->terms = 29, m->configuring = 0;
    return m;
}
static void model_free(Model *m) { free(m); }
static int model_reset(Model *m) {
    memcpy(m->reals, START, sizeof START), m->terms = 29;
    return 0;
}
static void model_begin(Model *m, double start) {}
static void model_initialise(Model *m) { memcpy(m->reals[Y], m->reals[X0], 2 * sizeof(double)); }

/* One Taylor step: x(h) = x + h x' + h^2/2 x'' + ... with x' = A x + B u. */
static void model_step(Model *m, double h) {
    const double *a = m->reals[A], *b = m->reals[B], u = m->reals[U][0];
    double *x = m->reals[Y];
    double term[2] = {a[0] * x[0] + a[1] * x[1] + b[0] * u, a[2] * x[0] + a[3] * x[1] + b[1] * u};
    for (int k = 1; k <= (int)m->terms; k++) {
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

fmi3Status fmi3EnterConfigurationMode(fmi3Instance c) {
    ((Model *)c)->configuring = 1;
    return fmi3OK;
}
fmi3Status fmi3ExitConfigurationMode(fmi3Instance c) {
    ((Model *)c)->configuring = 0;
    return fmi3OK;
}
fmi3Status fmi3GetUInt64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3UInt64 value[],
                         size_t nv) {
    for (size_t i = 0; i < n; i++) value[i] = vr[i] == TERMS ? ((Model *)c)->terms : 2;
    return fmi3OK;
}
fmi3Status fmi3SetUInt64(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                         const fmi3UInt64 value[], size_t nv) {
    Model *m = c;
    if (!m->configuring || n != 1 || vr[0] != TERMS) return fmi3Error;
    m->terms = value[0];
    return fmi3OK;
}

#define CONFIGURED
#include "absent3.h"
