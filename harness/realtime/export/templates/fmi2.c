/* @TITLE@ as an FMU of FMI 2.0 for co-simulation. */
#include "fmi2.h"

#include "fmi_model.h"

typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    fmi2ComponentEnvironment environment;
    char name[256];
} callbacks;

static void say(const callbacks *importer, int status, const char *text) {
    if (importer->logger != NULL) {
        importer->logger(importer->environment, importer->name, (fmi2Status) status, "logStatusError", "%s", text);
    }
}

#include "fmi_instance.h"

#define API FMI2_Export

API const char *fmi2GetTypesPlatform(void) {
    return "default";
}

API const char *fmi2GetVersion(void) {
    return "2.0";
}

API fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                                   const fmi2String categories[]) {
    (void) c, (void) loggingOn, (void) nCategories, (void) categories;
    return fmi2OK;
}

API fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                                  fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                                  fmi2Boolean visible, fmi2Boolean loggingOn) {
    callbacks importer = {NULL, NULL, ""};
    (void) fmuResourceLocation, (void) visible, (void) loggingOn;
    if (functions != NULL) {
        importer.logger = functions->logger;
        importer.environment = functions->componentEnvironment;
    }
    snprintf(importer.name, sizeof importer.name, "%s", instanceName == NULL ? MODEL_NAME : instanceName);
    if (fmuType != fmi2CoSimulation) {
        say(&importer, IS_ERROR, "it is for co-simulation, not for model exchange");
        return NULL;
    }
    return instantiated(importer, fmuGUID);
}

API void fmi2FreeInstance(fmi2Component c) {
    free(c);
}

API fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance,
                                   fmi2Real startTime, fmi2Boolean stopTimeDefined, fmi2Real stopTime) {
    (void) toleranceDefined, (void) tolerance, (void) stopTimeDefined, (void) stopTime;
    ((instance *) c)->now.start = startTime;
    return fmi2OK;
}

API fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    return (fmi2Status) enter_initialization(c, ((instance *) c)->now.start);
}

API fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    return (fmi2Status) exit_initialization(c);
}

API fmi2Status fmi2Terminate(fmi2Component c) {
    ((instance *) c)->now.at = TERMINATED;
    return fmi2OK;
}

API fmi2Status fmi2Reset(fmi2Component c) {
    restart(c);
    return fmi2OK;
}

static int get_reals(instance *c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[]) {
    GET(c, vr, nvr, 'r', AS_REAL, value);
}

static int get_integers(instance *c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[]) {
    GET(c, vr, nvr, 'i', AS_INTEGER, value);
}

static int get_booleans(instance *c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[]) {
    GET(c, vr, nvr, 'b', AS_TRUTH, value);
}

static int set_reals(instance *c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[]) {
    SET(c, vr, nvr, 'r', value);
}

static int set_booleans(instance *c, const fmi2ValueReference vr[], size_t nvr, const fmi2Boolean value[]) {
    SET(c, vr, nvr, 'b', value);
}

static fmi2Status none(instance *c, size_t count, const char *what) {
    return count == 0 ? fmi2OK : (fmi2Status) refused(c, IS_ERROR, "it has none of these: ", what);
}

API fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[]) {
    return (fmi2Status) get_reals(c, vr, nvr, value);
}

API fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[]) {
    return (fmi2Status) get_integers(c, vr, nvr, value);
}

API fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[]) {
    return (fmi2Status) get_booleans(c, vr, nvr, value);
}

API fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[]) {
    (void) vr, (void) value;
    return none(c, nvr, "strings");
}

API fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[]) {
    return (fmi2Status) set_reals(c, vr, nvr, value);
}

API fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer value[]) {
    (void) vr, (void) value;
    return none(c, nvr, "integers that can be set");
}

API fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Boolean value[]) {
    return (fmi2Status) set_booleans(c, vr, nvr, value);
}

API fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2String value[]) {
    (void) vr, (void) value;
    return none(c, nvr, "strings");
}

API fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    return (fmi2Status) kept(c, &((instance *) c)->now, sizeof(memory), FMUstate);
}

API fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate) {
    return (fmi2Status) restored(c, FMUstate);
}

API fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    (void) c;
    free(*FMUstate);
    *FMUstate = NULL;
    return fmi2OK;
}

API fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size) {
    (void) c, (void) FMUstate;
    *size = sizeof(memory);
    return fmi2OK;
}

API fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[], size_t size) {
    return (fmi2Status) written(c, FMUstate, serializedState, size);
}

API fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                       fmi2FMUstate *FMUstate) {
    return (fmi2Status) kept(c, serializedState, size, FMUstate);
}

API fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[], size_t nUnknown,
                                            const fmi2ValueReference vKnown_ref[], size_t nKnown,
                                            const fmi2Real dvKnown[], fmi2Real dvUnknown[]) {
    (void) vUnknown_ref, (void) vKnown_ref, (void) nKnown, (void) dvKnown, (void) dvUnknown;
    return none(c, nUnknown, "derivatives");
}

API fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                           const fmi2Integer order[], const fmi2Real value[]) {
    (void) vr, (void) order, (void) value;
    return none(c, nvr, "derivatives of inputs");
}

API fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                            const fmi2Integer order[], fmi2Real value[]) {
    (void) vr, (void) order, (void) value;
    return none(c, nvr, "derivatives of outputs");
}

API fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                          fmi2Boolean noSetFMUStatePriorToCurrentPoint) {
    (void) noSetFMUStatePriorToCurrentPoint;
    return (fmi2Status) advance(c, currentCommunicationPoint, communicationStepSize);
}

API fmi2Status fmi2CancelStep(fmi2Component c) {
    return none(c, 1, "steps that are still being taken");
}

API fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value) {
    (void) c, (void) s, (void) value;
    return fmi2Discard;
}

API fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value) {
    if (s != fmi2LastSuccessfulTime) {
        return fmi2Discard;
    }
    *value = time_of(c);
    return fmi2OK;
}

API fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value) {
    (void) c, (void) s, (void) value;
    return fmi2Discard;
}

API fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value) {
    (void) c;
    if (s != fmi2Terminated) {
        return fmi2Discard;
    }
    *value = 0;
    return fmi2OK;
}

API fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value) {
    (void) c, (void) s, (void) value;
    return fmi2Discard;
}
