/*
 * The life of a unit. Before it come
 *
 *     MODEL_GUID, MODEL_INPUTS, MODEL_SETTABLE (inputs, then parameters), MODEL_REALS (these, then
 *     constants and outputs), MODEL_BOOLEANS, model_values[MODEL_REALS] (at the start),
 *     model_least[MODEL_SETTABLE], model_memory, model_begin, model_outputs and model_advance.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef enum { INSTANTIATED, INITIALIZING, STEPPING, TERMINATED } fmi2_phase;

/* Everything that a state of the unit consists of: no pointers. */
typedef struct {
    model_memory memory;
    double time;
    double reals[MODEL_REALS];
    int booleans[MODEL_BOOLEANS];
    int stale; /* whether something was set since the outputs were computed */
    fmi2_phase phase;
} fmi2_snapshot;

typedef struct {
    fmi2CallbackFunctions callbacks;
    char name[128];
} fmi2_host;

typedef struct {
    fmi2_snapshot now;
    fmi2_host host;
} fmi2_unit;

static void *fmi2_allocate(const fmi2_host *host, size_t size)
{
    return host->callbacks.allocateMemory ? host->callbacks.allocateMemory(1, size)
                                          : calloc(1, size);
}

static void fmi2_release(const fmi2_host *host, void *memory)
{
    if (host->callbacks.freeMemory) host->callbacks.freeMemory(memory);
    else free(memory);
}

static void fmi2_tell(const fmi2_host *host, const char *message)
{
    if (host->callbacks.logger) {
        host->callbacks.logger(host->callbacks.componentEnvironment, host->name, fmi2Error,
                               "logStatusError", message);
    }
}

static fmi2Status fmi2_refuse(fmi2Component component, const char *message)
{
    if (component) fmi2_tell(&((fmi2_unit *)component)->host, message);
    return fmi2Error;
}

static void fmi2_start(fmi2_unit *unit)
{
    memset(&unit->now, 0, sizeof unit->now);
    memcpy(unit->now.reals, model_values, sizeof model_values);
    unit->now.stale = 1;
    unit->now.phase = INSTANTIATED;
}

static void fmi2_refresh(fmi2_snapshot *now)
{
    if (!now->stale) return;
    if (now->phase <= INITIALIZING) model_begin(&now->memory, now->reals);
    model_outputs(&now->memory, now->reals, now->booleans);
    now->stale = 0;
}

FMI2_FUNCTION(const char *, fmi2GetTypesPlatform)(void)
{
    return "default";
}

FMI2_FUNCTION(const char *, fmi2GetVersion)(void)
{
    return "2.0";
}

FMI2_FUNCTION(fmi2Status, fmi2SetDebugLogging)(fmi2Component component, fmi2Boolean on,
                                               size_t count, const fmi2String categories[])
{
    (void)on, (void)count, (void)categories; /* only errors are told, and always */
    return component ? fmi2OK : fmi2Error;
}

FMI2_FUNCTION(fmi2Component, fmi2Instantiate)(fmi2String name, fmi2Type type, fmi2String guid,
                                              fmi2String resources,
                                              const fmi2CallbackFunctions *callbacks,
                                              fmi2Boolean visible, fmi2Boolean logging)
{
    fmi2_host host;
    fmi2_unit *unit;

    (void)resources, (void)visible, (void)logging;
    memset(&host, 0, sizeof host);
    if (callbacks) host.callbacks = *callbacks;
    if (name) strncpy(host.name, name, sizeof host.name - 1);
    if (type != fmi2CoSimulation) {
        fmi2_tell(&host, "this unit is for co-simulation only");
        return NULL;
    }
    if (!guid || strcmp(guid, MODEL_GUID) != 0) {
        fmi2_tell(&host, "the GUID is not that of this library");
        return NULL;
    }
    unit = (fmi2_unit *)fmi2_allocate(&host, sizeof *unit);
    if (!unit) {
        fmi2_tell(&host, "there is no memory for this unit");
        return NULL;
    }
    unit->host = host;
    fmi2_start(unit);
    return unit;
}

FMI2_FUNCTION(void, fmi2FreeInstance)(fmi2Component component)
{
    fmi2_host host;

    if (!component) return;
    host = ((fmi2_unit *)component)->host;
    fmi2_release(&host, component);
}

FMI2_FUNCTION(fmi2Status, fmi2SetupExperiment)(fmi2Component component, fmi2Boolean tolerance_known,
                                               fmi2Real tolerance, fmi2Real start,
                                               fmi2Boolean stop_known, fmi2Real stop)
{
    fmi2_unit *unit = (fmi2_unit *)component;

    (void)tolerance_known, (void)tolerance, (void)stop_known, (void)stop;
    if (!unit || unit->now.phase != INSTANTIATED) {
        return fmi2_refuse(component, "an experiment is set up after instantiation only");
    }
    if (!isfinite(start)) return fmi2_refuse(component, "the start time is not a number");
    unit->now.time = start;
    return fmi2OK;
}

static fmi2Status fmi2_pass(fmi2Component component, fmi2_phase from, fmi2_phase to)
{
    fmi2_unit *unit = (fmi2_unit *)component;

    if (!unit || unit->now.phase != from) {
        return fmi2_refuse(component, "this call is not allowed in the present mode");
    }
    fmi2_refresh(&unit->now);
    unit->now.phase = to;
    return fmi2OK;
}

FMI2_FUNCTION(fmi2Status, fmi2EnterInitializationMode)(fmi2Component component)
{
    return fmi2_pass(component, INSTANTIATED, INITIALIZING);
}

FMI2_FUNCTION(fmi2Status, fmi2ExitInitializationMode)(fmi2Component component)
{
    return fmi2_pass(component, INITIALIZING, STEPPING);
}

FMI2_FUNCTION(fmi2Status, fmi2Terminate)(fmi2Component component)
{
    return fmi2_pass(component, STEPPING, TERMINATED);
}

FMI2_FUNCTION(fmi2Status, fmi2Reset)(fmi2Component component)
{
    if (!component) return fmi2Error;
    fmi2_start((fmi2_unit *)component);
    return fmi2OK;
}
