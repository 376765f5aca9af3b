/* FMI 2.0 and 3.0, co-simulation and model exchange, around equations: what tests make FMUs of.
   Generated before it: VERSION, NU, NP, NX, NY, NZ, SUBSTEPS, START, START_X, TOKEN, evaluate() and the hooks IN_*. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#define NR (NU + NP + NY)
#if VERSION == 2
#include "fmi2Functions.h"
typedef fmi2Component Handle; typedef fmi2Status Status; typedef fmi2ValueReference Ref; typedef fmi2Boolean Bool;
#define API(name) fmi2##name
#else
#include "fmi3Functions.h"
typedef fmi3Instance Handle; typedef fmi3Status Status; typedef fmi3ValueReference Ref; typedef fmi3Boolean Bool;
#define API(name) fmi3##name
#endif
#define OK 0

typedef struct {
    double r[NR + 1], x[NX + 1], dx[NX + 1], time, next;
    int b[8];
#if VERSION == 2
    const fmi2CallbackFunctions *callbacks;
#else
    fmi3LogMessageCallback logger; fmi3InstanceEnvironment environment;
#endif
} Model;

static void evaluate(Model *m, const double *u, const double *p, const double *x, double *dx, double *y);
static void say(Model *m, const char *text) {
#if VERSION == 2
    m->callbacks->logger(0, "truck", 3, "logStatusError", "%s", text);
#else
    m->logger(m->environment, 3, "logStatusError", text);
#endif
}
static void start(Model *m) {
    static const double r[NR + 1] = START, x[NX + 1] = START_X;
    memcpy(m->r, r, sizeof r); memcpy(m->x, x, sizeof x);
    m->time = 0.0; m->next = INFINITY; memset(m->b, 0, sizeof m->b);
}
static void all(Model *m) { evaluate(m, m->r, m->r + NU, m->x, m->dx, m->r + NU + NP); }

#include "hooks.c"

static Model *made(void) { Model *m = calloc(1, sizeof *m); start(m); return m; }
#if VERSION == 2
const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
Handle fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                       const fmi2CallbackFunctions *callbacks, Bool visible, Bool logging) {
    Model *m = made(); m->callbacks = callbacks;
    if (strcmp(token, TOKEN) || type != KIND) return 0;
    IN_INSTANTIATE
    return m;
}
Status fmi2SetupExperiment(Handle h, Bool a, double b, double c, Bool d, double e) { return OK; }
Status fmi2EnterInitializationMode(Handle h) { return OK; }
#else
const char *fmi3GetVersion(void) { return "3.0"; }
#if KIND
Handle fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, Bool visible, Bool logging,
                                   Bool events, Bool early, const Ref refs[], size_t n, fmi3InstanceEnvironment e,
                                   fmi3LogMessageCallback logger, fmi3IntermediateUpdateCallback update) {
#else
Handle fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, Bool visible, Bool logging,
                                    fmi3InstanceEnvironment e, fmi3LogMessageCallback logger) {
#endif
    Model *m = made(); m->logger = logger; m->environment = e;
    if (strcmp(token, TOKEN)) return 0;
    IN_INSTANTIATE
    return m;
}
Status fmi3EnterInitializationMode(Handle h, Bool a, double b, double c, Bool d, double e) { return OK; }
#endif
void API(FreeInstance)(Handle h) { free(h); }
Status API(SetDebugLogging)(Handle h, Bool on, size_t n, const char *const names[]) { return OK; }
Status API(ExitInitializationMode)(Handle h) { Model *m = h; IN_EXIT_INITIALIZATION return OK; }
Status API(Terminate)(Handle h) { return OK; }
Status API(Reset)(Handle h) { Model *m = h; IN_RESET start(m); return OK; }
#if VERSION == 2
#define STATE(name) fmi2##name##FMUstate
#else
#define STATE(name) fmi3##name##FMUState
#endif
Status STATE(Get)(Handle h, void **kept) {
    if (!*kept) *kept = malloc(sizeof(Model));
    memcpy(*kept, h, sizeof(Model));
    return OK;
}
Status STATE(Set)(Handle h, void *kept) { memcpy(h, kept, sizeof(Model)); return OK; }
Status STATE(Free)(Handle h, void **kept) { free(*kept); *kept = 0; return OK; }
#if VERSION == 2
Status fmi2SetReal(Handle h, const Ref refs[], size_t n, const double v[]) {
#else
Status fmi3SetFloat64(Handle h, const Ref refs[], size_t n, const double v[], size_t nv) {
#endif
    Model *m = h;
    for (size_t i = 0; i < n; i++) { if (refs[i] >= NU + NP) return 3; m->r[refs[i]] = v[i]; }
    return OK;
}
#if VERSION == 2
Status fmi2GetReal(Handle h, const Ref refs[], size_t n, double v[]) {
#else
Status fmi3GetFloat64(Handle h, const Ref refs[], size_t n, double v[], size_t nv) {
#endif
    Model *m = h;
    all(m);
    IN_GET
    for (size_t i = 0; i < n; i++) v[i] = m->r[refs[i]];
    return OK;
}
#if VERSION == 2
Status fmi2SetBoolean(Handle h, const Ref refs[], size_t n, const int v[]) {
#else
Status fmi3SetBoolean(Handle h, const Ref refs[], size_t n, const bool v[], size_t nv) {
#endif
    for (size_t i = 0; i < n; i++) ((Model *)h)->b[refs[i] - 1000] = v[i];
    return OK;
}
#if KIND
#if VERSION == 2
Status fmi2DoStep(Handle h, double t, double step, Bool keep) {
#else
Status fmi3DoStep(Handle h, double t, double step, Bool keep, Bool *event, Bool *end, Bool *early, double *last) {
    *event = *end = *early = 0; *last = t + step;
#endif
    Model *m = h;
    IN_STEP
    for (int s = 0; s < SUBSTEPS; s++) {
        all(m);
        for (int i = 0; i < NX; i++) m->x[i] = m->x[i] + step / SUBSTEPS * m->dx[i];
    }
    m->time = t + step;
    return OK;
}
#else
Status API(SetTime)(Handle h, double t) { ((Model *)h)->time = t; return OK; }
Status API(SetContinuousStates)(Handle h, const double x[], size_t n) { memcpy(((Model *)h)->x, x, n * sizeof *x); return OK; }
Status API(GetContinuousStates)(Handle h, double x[], size_t n) { memcpy(x, ((Model *)h)->x, n * sizeof *x); return OK; }
Status API(EnterEventMode)(Handle h) { return OK; }
Status API(EnterContinuousTimeMode)(Handle h) { return OK; }
Status API(GetEventIndicators)(Handle h, double z[], size_t n) { Model *m = h; IN_INDICATORS return OK; }
#if VERSION == 2
Status fmi2GetDerivatives(Handle h, double dx[], size_t n) {
#else
Status fmi3GetContinuousStateDerivatives(Handle h, double dx[], size_t n) {
#endif
    Model *m = h;
    double t = m->time;
    (void)t;
    IN_STEP
    all(m); memcpy(dx, m->dx, n * sizeof *dx); return OK;
}
Status API(CompletedIntegratorStep)(Handle h, Bool keep, Bool *event, Bool *end) {
    Model *m = h; *event = *end = 0; IN_COMPLETED return OK;
}
#if VERSION == 2
Status fmi2NewDiscreteStates(Handle h, fmi2EventInfo *info) {
    Model *m = h; int again = 0, end = 0; m->next = INFINITY;
    IN_EVENT
    memset(info, 0, sizeof *info);
    info->newDiscreteStatesNeeded = again; info->terminateSimulation = end; info->valuesOfContinuousStatesChanged = 1;
    info->nextEventTimeDefined = isfinite(m->next); info->nextEventTime = m->next;
    return OK;
}
#else
Status fmi3UpdateDiscreteStates(Handle h, Bool *a, Bool *e, Bool *nominals, Bool *values, Bool *defined, double *next) {
    Model *m = h; int again = 0, end = 0; m->next = INFINITY;
    IN_EVENT
    *a = again; *e = end; *nominals = 0; *values = 1; *defined = isfinite(m->next); *next = m->next;
    return OK;
}
#endif
#endif
