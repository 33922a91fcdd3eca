/* An FMU of FMI 2.0 of model exchange alone. */
#include "fmi2Functions.h"
#include "exchange.h"

#define MODEL_EXCHANGE
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

#include "absent2.h"
