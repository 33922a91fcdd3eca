/* What an FMU of FMI 3.0 has to export besides entry3.h and the functions of its own kind:
   MODEL_EXCHANGE is defined for that, else it is co-simulation. OWN_TYPES: it has numbers of the types
   Int32, Int64, Boolean and texts that are set. CONFIGURED: it has structural parameters. Nothing here
   calls it. */
#define ABSENT(NAME) fmi3Status NAME(void) { return fmi3Error; }
ABSENT(fmi3SetDebugLogging) ABSENT(fmi3InstantiateScheduledExecution)
ABSENT(fmi3GetFloat32) ABSENT(fmi3GetInt8) ABSENT(fmi3GetUInt8) ABSENT(fmi3GetInt16)
ABSENT(fmi3GetUInt16) ABSENT(fmi3GetUInt32) ABSENT(fmi3GetString)
ABSENT(fmi3GetBinary) ABSENT(fmi3GetClock) ABSENT(fmi3SetFloat32) ABSENT(fmi3SetInt8)
ABSENT(fmi3SetUInt8) ABSENT(fmi3SetInt16) ABSENT(fmi3SetUInt16) ABSENT(fmi3SetUInt32)
ABSENT(fmi3SetBinary) ABSENT(fmi3SetClock)
ABSENT(fmi3GetNumberOfVariableDependencies) ABSENT(fmi3GetVariableDependencies)
ABSENT(fmi3GetFMUState) ABSENT(fmi3SetFMUState) ABSENT(fmi3FreeFMUState)
ABSENT(fmi3SerializedFMUStateSize) ABSENT(fmi3SerializeFMUState)
ABSENT(fmi3DeserializeFMUState) ABSENT(fmi3GetDirectionalDerivative)
ABSENT(fmi3GetAdjointDerivative) ABSENT(fmi3GetIntervalDecimal)
ABSENT(fmi3GetIntervalFraction) ABSENT(fmi3GetShiftDecimal) ABSENT(fmi3GetShiftFraction)
ABSENT(fmi3SetIntervalDecimal) ABSENT(fmi3SetIntervalFraction)
ABSENT(fmi3SetShiftDecimal) ABSENT(fmi3SetShiftFraction)
ABSENT(fmi3EvaluateDiscreteStates) ABSENT(fmi3EnterStepMode)
ABSENT(fmi3GetOutputDerivatives) ABSENT(fmi3ActivateModelPartition)
#ifndef CONFIGURED
ABSENT(fmi3EnterConfigurationMode) ABSENT(fmi3ExitConfigurationMode)
ABSENT(fmi3GetUInt64) ABSENT(fmi3SetUInt64)
#endif
#ifndef OWN_TYPES
ABSENT(fmi3GetInt32) ABSENT(fmi3SetInt32) ABSENT(fmi3GetInt64) ABSENT(fmi3SetInt64)
ABSENT(fmi3GetBoolean) ABSENT(fmi3SetBoolean) ABSENT(fmi3SetString)
#endif
#ifdef MODEL_EXCHANGE
ABSENT(fmi3InstantiateCoSimulation) ABSENT(fmi3DoStep)
#else
ABSENT(fmi3InstantiateModelExchange) ABSENT(fmi3EnterEventMode)
ABSENT(fmi3UpdateDiscreteStates) ABSENT(fmi3EnterContinuousTimeMode)
ABSENT(fmi3CompletedIntegratorStep) ABSENT(fmi3SetTime) ABSENT(fmi3SetContinuousStates)
ABSENT(fmi3GetContinuousStateDerivatives) ABSENT(fmi3GetEventIndicators)
ABSENT(fmi3GetContinuousStates) ABSENT(fmi3GetNominalsOfContinuousStates)
ABSENT(fmi3GetNumberOfEventIndicators) ABSENT(fmi3GetNumberOfContinuousStates)
#endif
