/* @TITLE@ as an FMU of FMI 3.0 for co-simulation. */
#include "fmi3.h"

#include "fmi_model.h"

typedef struct {
    fmi3LogMessageCallback logger;
    fmi3InstanceEnvironment environment;
} callbacks;

static void say(const callbacks *importer, int status, const char *text) {
    if (importer->logger != NULL) {
        importer->logger(importer->environment, (fmi3Status) status, "logStatusError", text);
    }
}

#include "fmi_instance.h"

#define API FMI3_Export fmi3Status
#define REFERENCES const fmi3ValueReference valueReferences[], size_t nValueReferences

static fmi3Status none(fmi3Instance c, size_t count, const char *what) {
    return count == 0 ? fmi3OK : (fmi3Status) refused(c, IS_ERROR, "it has none of these: ", what);
}

FMI3_Export const char *fmi3GetVersion(void) {
    return "3.0";
}

API fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean loggingOn, size_t nCategories, const fmi3String categories[]) {
    (void) c, (void) loggingOn, (void) nCategories, (void) categories;
    return fmi3OK;
}

FMI3_Export fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath, fmi3Boolean visible,
    fmi3Boolean loggingOn, fmi3Boolean eventModeUsed, fmi3Boolean earlyReturnAllowed,
    const fmi3ValueReference requiredIntermediateVariables[], size_t nRequiredIntermediateVariables,
    fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage,
    fmi3IntermediateUpdateCallback intermediateUpdate) {
    const callbacks importer = {logMessage, instanceEnvironment};
    (void) instanceName, (void) resourcePath, (void) visible, (void) loggingOn, (void) eventModeUsed;
    (void) earlyReturnAllowed, (void) requiredIntermediateVariables, (void) intermediateUpdate;
    if (nRequiredIntermediateVariables > 0) {
        say(&importer, IS_ERROR, "it has no intermediate variables");
        return NULL;
    }
    return instantiated(importer, instantiationToken);
}

FMI3_Export fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
                                                      fmi3String resourcePath, fmi3Boolean visible,
                                                      fmi3Boolean loggingOn,
                                                      fmi3InstanceEnvironment instanceEnvironment,
                                                      fmi3LogMessageCallback logMessage) {
    const callbacks importer = {logMessage, instanceEnvironment};
    (void) instanceName, (void) instantiationToken, (void) resourcePath, (void) visible, (void) loggingOn;
    say(&importer, IS_ERROR, "it is for co-simulation, not for model exchange");
    return NULL;
}

FMI3_Export fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath, fmi3Boolean visible,
    fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage,
    fmi3ClockUpdateCallback clockUpdate, fmi3LockPreemptionCallback lockPreemption,
    fmi3UnlockPreemptionCallback unlockPreemption) {
    const callbacks importer = {logMessage, instanceEnvironment};
    (void) instanceName, (void) instantiationToken, (void) resourcePath, (void) visible, (void) loggingOn;
    (void) clockUpdate, (void) lockPreemption, (void) unlockPreemption;
    say(&importer, IS_ERROR, "it is for co-simulation, not for scheduled execution");
    return NULL;
}

FMI3_Export void fmi3FreeInstance(fmi3Instance c) {
    free(c);
}

API fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime) {
    (void) toleranceDefined, (void) tolerance, (void) stopTimeDefined, (void) stopTime;
    return (fmi3Status) enter_initialization(c, startTime);
}

API fmi3ExitInitializationMode(fmi3Instance c) {
    return (fmi3Status) exit_initialization(c);
}

API fmi3Terminate(fmi3Instance c) {
    ((instance *) c)->now.at = TERMINATED;
    return fmi3OK;
}

API fmi3Reset(fmi3Instance c) {
    restart(c);
    return fmi3OK;
}

static int get_reals(instance *c, REFERENCES, fmi3Float64 values[]) {
    GET(c, valueReferences, nValueReferences, 'r', AS_REAL, values);
}

static int get_integers(instance *c, REFERENCES, fmi3Int32 values[]) {
    GET(c, valueReferences, nValueReferences, 'i', AS_INTEGER, values);
}

static int get_booleans(instance *c, REFERENCES, fmi3Boolean values[]) {
    GET(c, valueReferences, nValueReferences, 'b', AS_TRUTH, values);
}

static int set_reals(instance *c, REFERENCES, const fmi3Float64 values[]) {
    SET(c, valueReferences, nValueReferences, 'r', values);
}

static int set_booleans(instance *c, REFERENCES, const fmi3Boolean values[]) {
    SET(c, valueReferences, nValueReferences, 'b', values);
}

/* Functions to get or set numbers of a type, by another function; each variable is one number. */
#define ACCESS(name, type, function)                                                                                   \
    API fmi3##name(fmi3Instance c, REFERENCES, type values[], size_t nValues) {                                        \
        if (nValues != nValueReferences) {                                                                             \
            return (fmi3Status) refused(c, IS_ERROR, "each variable is one number, and there are more or fewer", "");  \
        }                                                                                                              \
        return (fmi3Status) function(c, valueReferences, nValueReferences, values);                                    \
    }

/* Functions to get or set numbers of a type that no variable has. */
#define NO_ACCESS(name, type)                                                                                          \
    API fmi3##name(fmi3Instance c, REFERENCES, type values[], size_t nValues) {                                        \
        (void) valueReferences, (void) values, (void) nValues;                                                         \
        return none(c, nValueReferences, "variables to " #name);                                                       \
    }

ACCESS(GetFloat64, fmi3Float64, get_reals)
ACCESS(SetFloat64, const fmi3Float64, set_reals)
ACCESS(GetBoolean, fmi3Boolean, get_booleans)
ACCESS(SetBoolean, const fmi3Boolean, set_booleans)
ACCESS(GetInt32, fmi3Int32, get_integers)
NO_ACCESS(SetInt32, const fmi3Int32)
NO_ACCESS(GetFloat32, fmi3Float32)
NO_ACCESS(SetFloat32, const fmi3Float32)
NO_ACCESS(GetInt8, fmi3Int8)
NO_ACCESS(SetInt8, const fmi3Int8)
NO_ACCESS(GetUInt8, fmi3UInt8)
NO_ACCESS(SetUInt8, const fmi3UInt8)
NO_ACCESS(GetInt16, fmi3Int16)
NO_ACCESS(SetInt16, const fmi3Int16)
NO_ACCESS(GetUInt16, fmi3UInt16)
NO_ACCESS(SetUInt16, const fmi3UInt16)
NO_ACCESS(GetUInt32, fmi3UInt32)
NO_ACCESS(SetUInt32, const fmi3UInt32)
NO_ACCESS(GetInt64, fmi3Int64)
NO_ACCESS(SetInt64, const fmi3Int64)
NO_ACCESS(GetUInt64, fmi3UInt64)
NO_ACCESS(SetUInt64, const fmi3UInt64)
NO_ACCESS(GetString, fmi3String)
NO_ACCESS(SetString, const fmi3String)

API fmi3GetBinary(fmi3Instance c, REFERENCES, size_t valueSizes[], fmi3Binary values[], size_t nValues) {
    (void) valueReferences, (void) valueSizes, (void) values, (void) nValues;
    return none(c, nValueReferences, "binaries");
}

API fmi3SetBinary(fmi3Instance c, REFERENCES, const size_t valueSizes[], const fmi3Binary values[], size_t nValues) {
    (void) valueReferences, (void) valueSizes, (void) values, (void) nValues;
    return none(c, nValueReferences, "binaries");
}

API fmi3GetClock(fmi3Instance c, REFERENCES, fmi3Clock values[]) {
    (void) valueReferences, (void) values;
    return none(c, nValueReferences, "clocks");
}

API fmi3SetClock(fmi3Instance c, REFERENCES, const fmi3Clock values[]) {
    (void) valueReferences, (void) values;
    return none(c, nValueReferences, "clocks");
}

API fmi3GetFMUState(fmi3Instance c, fmi3FMUState *FMUState) {
    return (fmi3Status) kept(c, &((instance *) c)->now, sizeof(memory), FMUState);
}

API fmi3SetFMUState(fmi3Instance c, fmi3FMUState FMUState) {
    return (fmi3Status) restored(c, FMUState);
}

API fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *FMUState) {
    (void) c;
    free(*FMUState);
    *FMUState = NULL;
    return fmi3OK;
}

API fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState FMUState, size_t *size) {
    (void) c, (void) FMUState;
    *size = sizeof(memory);
    return fmi3OK;
}

API fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState FMUState, fmi3Byte serializedState[], size_t size) {
    return (fmi3Status) written(c, FMUState, serializedState, size);
}

API fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte serializedState[], size_t size, fmi3FMUState *FMUState) {
    return (fmi3Status) kept(c, serializedState, size, FMUState);
}

API fmi3DoStep(fmi3Instance c, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
               fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded,
               fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime) {
    const int status = advance(c, currentCommunicationPoint, communicationStepSize);
    (void) noSetFMUStatePriorToCurrentPoint;
    *eventHandlingNeeded = false;
    *terminateSimulation = false;
    *earlyReturn = false;
    *lastSuccessfulTime = time_of(c);
    return (fmi3Status) status;
}

/* What co-simulation without events, clocks, arrays and derivatives has no use for. */
#define NO_MODE(name)                                                                                                  \
    API fmi3##name(fmi3Instance c) {                                                                                   \
        return none(c, 1, #name);                                                                                      \
    }

NO_MODE(EnterConfigurationMode)
NO_MODE(ExitConfigurationMode)
NO_MODE(EnterEventMode)
NO_MODE(EnterStepMode)
NO_MODE(EvaluateDiscreteStates)

API fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *discreteStatesNeedUpdate, fmi3Boolean *terminateSimulation,
                             fmi3Boolean *nominalsOfContinuousStatesChanged,
                             fmi3Boolean *valuesOfContinuousStatesChanged, fmi3Boolean *nextEventTimeDefined,
                             fmi3Float64 *nextEventTime) {
    (void) discreteStatesNeedUpdate, (void) terminateSimulation, (void) nominalsOfContinuousStatesChanged;
    (void) valuesOfContinuousStatesChanged, (void) nextEventTimeDefined, (void) nextEventTime;
    return none(c, 1, "events");
}

API fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference valueReference, size_t *nDependencies) {
    (void) valueReference;
    *nDependencies = 0;
    return none(c, 1, "dependencies at run time");
}

API fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference dependent, size_t elementIndicesOfDependent[],
                                fmi3ValueReference independents[], size_t elementIndicesOfIndependents[],
                                fmi3DependencyKind dependencyKinds[], size_t nDependencies) {
    (void) dependent, (void) elementIndicesOfDependent, (void) independents, (void) elementIndicesOfIndependents;
    (void) dependencyKinds, (void) nDependencies;
    return none(c, 1, "dependencies at run time");
}

#define NO_DERIVATIVE(name)                                                                                            \
    API fmi3##name(fmi3Instance c, const fmi3ValueReference unknowns[], size_t nUnknowns,                              \
                   const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[], size_t nSeed,          \
                   fmi3Float64 sensitivity[], size_t nSensitivity) {                                                   \
        (void) unknowns, (void) knowns, (void) nKnowns, (void) seed, (void) nSeed, (void) sensitivity;                 \
        (void) nSensitivity;                                                                                           \
        return none(c, nUnknowns, "derivatives");                                                                      \
    }

NO_DERIVATIVE(GetDirectionalDerivative)
NO_DERIVATIVE(GetAdjointDerivative)

API fmi3GetOutputDerivatives(fmi3Instance c, REFERENCES, const fmi3Int32 orders[], fmi3Float64 values[],
                             size_t nValues) {
    (void) valueReferences, (void) orders, (void) values, (void) nValues;
    return none(c, nValueReferences, "derivatives");
}

API fmi3GetIntervalDecimal(fmi3Instance c, REFERENCES, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]) {
    (void) valueReferences, (void) intervals, (void) qualifiers;
    return none(c, nValueReferences, "clocks");
}

API fmi3GetIntervalFraction(fmi3Instance c, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                            fmi3IntervalQualifier qualifiers[]) {
    (void) valueReferences, (void) counters, (void) resolutions, (void) qualifiers;
    return none(c, nValueReferences, "clocks");
}

#define NO_DECIMAL(name, type)                                                                                         \
    API fmi3##name(fmi3Instance c, REFERENCES, type numbers[]) {                                                       \
        (void) valueReferences, (void) numbers;                                                                        \
        return none(c, nValueReferences, "clocks");                                                                    \
    }

#define NO_FRACTION(name, type)                                                                                        \
    API fmi3##name(fmi3Instance c, REFERENCES, type counters[], type resolutions[]) {                                  \
        (void) valueReferences, (void) counters, (void) resolutions;                                                   \
        return none(c, nValueReferences, "clocks");                                                                    \
    }

NO_DECIMAL(GetShiftDecimal, fmi3Float64)
NO_DECIMAL(SetIntervalDecimal, const fmi3Float64)
NO_DECIMAL(SetShiftDecimal, const fmi3Float64)
NO_FRACTION(GetShiftFraction, fmi3UInt64)
NO_FRACTION(SetIntervalFraction, const fmi3UInt64)
NO_FRACTION(SetShiftFraction, const fmi3UInt64)

API fmi3EnterContinuousTimeMode(fmi3Instance c) {
    return none(c, 1, "continuous time");
}

API fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                fmi3Boolean *enterEventMode, fmi3Boolean *terminateSimulation) {
    (void) noSetFMUStatePriorToCurrentPoint, (void) enterEventMode, (void) terminateSimulation;
    return none(c, 1, "steps of an integrator");
}

API fmi3SetTime(fmi3Instance c, fmi3Float64 time) {
    (void) time;
    return none(c, 1, "continuous time");
}

/* Continuous states and events belong to model exchange. */
#define NO_STATES(name, type)                                                                                          \
    API fmi3##name(fmi3Instance c, type numbers[], size_t count) {                                                     \
        (void) numbers;                                                                                                \
        return none(c, count, "continuous states and events");                                                         \
    }

#define NO_NUMBER_OF(name)                                                                                             \
    API fmi3GetNumberOf##name(fmi3Instance c, size_t *count) {                                                         \
        (void) c;                                                                                                      \
        *count = 0;                                                                                                    \
        return fmi3OK;                                                                                                 \
    }

NO_STATES(SetContinuousStates, const fmi3Float64)
NO_STATES(GetContinuousStates, fmi3Float64)
NO_STATES(GetContinuousStateDerivatives, fmi3Float64)
NO_STATES(GetNominalsOfContinuousStates, fmi3Float64)
NO_STATES(GetEventIndicators, fmi3Float64)
NO_NUMBER_OF(ContinuousStates)
NO_NUMBER_OF(EventIndicators)

API fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clockReference, fmi3Float64 activationTime) {
    (void) clockReference, (void) activationTime;
    return none(c, 1, "partitions");
}
