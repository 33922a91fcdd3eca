/* What a co-simulation FMU of FMI 2.0 has to export as well; nothing here calls it. OWN_TYPES: it has
   integers, flags and texts; OWN_STATUS: it tells how a step went. */
#define ABSENT(NAME, ...) fmi2Status NAME(fmi2Component c, __VA_ARGS__) { return fmi2Error; }
#define WITH_VALUES(NAME, TYPE)                                                                    \
    ABSENT(NAME, const fmi2ValueReference vr[], size_t n, TYPE value[])
#ifndef OWN_TYPES
WITH_VALUES(fmi2GetInteger, fmi2Integer) WITH_VALUES(fmi2SetInteger, const fmi2Integer)
WITH_VALUES(fmi2GetBoolean, fmi2Boolean) WITH_VALUES(fmi2SetBoolean, const fmi2Boolean)
WITH_VALUES(fmi2GetString, fmi2String) WITH_VALUES(fmi2SetString, const fmi2String)
#endif
#ifndef OWN_STATUS
ABSENT(fmi2GetRealStatus, const fmi2StatusKind k, fmi2Real *v)
ABSENT(fmi2GetStatus, const fmi2StatusKind k, fmi2Status *v)
ABSENT(fmi2GetIntegerStatus, const fmi2StatusKind k, fmi2Integer *v)
ABSENT(fmi2GetBooleanStatus, const fmi2StatusKind k, fmi2Boolean *v)
ABSENT(fmi2GetStringStatus, const fmi2StatusKind k, fmi2String *v)
#endif
ABSENT(fmi2GetFMUstate, fmi2FMUstate *s)
ABSENT(fmi2SetFMUstate, fmi2FMUstate s)
ABSENT(fmi2FreeFMUstate, fmi2FMUstate *s)
ABSENT(fmi2SerializedFMUstateSize, fmi2FMUstate s, size_t *n)
ABSENT(fmi2SerializeFMUstate, fmi2FMUstate s, fmi2Byte b[], size_t n)
ABSENT(fmi2DeSerializeFMUstate, const fmi2Byte b[], size_t n, fmi2FMUstate *s)
ABSENT(fmi2GetDirectionalDerivative, const fmi2ValueReference u[], size_t nu,
       const fmi2ValueReference k[], size_t nk, const fmi2Real dk[], fmi2Real du[])
ABSENT(fmi2SetRealInputDerivatives, const fmi2ValueReference vr[], size_t n, const fmi2Integer o[],
       const fmi2Real v[])
ABSENT(fmi2GetRealOutputDerivatives, const fmi2ValueReference vr[], size_t n,
       const fmi2Integer o[], fmi2Real v[])
fmi2Status fmi2CancelStep(fmi2Component c) { return fmi2Error; }
