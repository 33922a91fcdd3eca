/* An FMU of FMI 2.0 of model exchange alone, or with BOTH of co-simulation, too, by Euler's method over its
   communication steps, of which the second half is implicit. */
#include "fmi2Functions.h"
#include "exchange.h"

#ifndef BOTH
#define MODEL_EXCHANGE
#endif
#define DERIVATIVES fmi2GetDerivatives
#include "entry2.h"
#include "exchange_entry.h"

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) {
    info->newDiscreteStatesNeeded = info->terminateSimulation = fmi2False;
    info->nominalsOfContinuousStatesChanged = info->valuesOfContinuousStatesChanged = fmi2False;
    info->nextEventTimeDefined = fmi2True;
    info->nextEventTime = update(c);
    return fmi2OK;
}

#ifdef BOTH
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real at, fmi2Real step, fmi2Boolean no_set) {
    Model *m = c;
    m->reals[V] += step * model_get(m, DV), m->reals[X] += step * m->reals[V];
    m->time = at + step;
    return fmi2OK;
}
#endif

#include "absent2.h"
