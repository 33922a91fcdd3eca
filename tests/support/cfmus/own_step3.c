/* The oscillator with steps of its own as an FMI 3.0 co-simulation FMU. */
#include "fmi3FunctionTypes.h"
#include "fmi3PlatformTypes.h"
#include "own_step.h"
#include "entry3.h"

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 at, fmi3Float64 step, fmi3Boolean no_set,
                      fmi3Boolean *events, fmi3Boolean *terminate, fmi3Boolean *early,
                      fmi3Float64 *reached) {
    *events = *terminate = *early = 0;
    *reached = at + step;
    return model_step(c, at, step) ? fmi3Error : fmi3OK;
}

#include "absent3.h"
