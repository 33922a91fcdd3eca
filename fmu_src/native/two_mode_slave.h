/* What the FMUs of two hybridised modes share: parameters, and outputs that follow from them. */
#ifndef TWO_MODE_SLAVE_H
#define TWO_MODE_SLAVE_H

#include "oscillator_equations.h"
#include "slave.h"

enum { DERIVED_COUNT = 10 };

struct parameters parameters_of(const struct slave *slave);
/* Coupling, uncoupled eigenfrequencies, damping matrix, line widths and quality factors. */
void write_derived(const struct parameters *p, double *outputs, struct report *report);
bool check_substep(double substep, struct report *report);

#endif
