/* An FMU of FMI 3.0 of model exchange alone. */
#include "fmi3FunctionTypes.h"
#include "fmi3PlatformTypes.h"
#include "exchange.h"

#define MODEL_EXCHANGE
#define DERIVATIVES fmi3GetContinuousStateDerivatives
#include "entry3.h"
#include "exchange_entry.h"

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *needed, fmi3Boolean *end,
                                    fmi3Boolean *nominals, fmi3Boolean *states, fmi3Boolean *defined,
                                    fmi3Float64 *next) {
    *needed = *end = *nominals = *states = 0;
    *defined = 1;
    *next = update(c);
    return fmi3OK;
}
fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *n) {
    *n = 2;
    return fmi3OK;
}
fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *n) {
    *n = 1;
    return fmi3OK;
}

#include "absent3.h"
