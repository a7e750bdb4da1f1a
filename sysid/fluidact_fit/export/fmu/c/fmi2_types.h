/*
 * Types and functions of the Functional Mock-up Interface 2.0 for co-simulation, declared anew
 * after the public standard (fmi-standard.org).
 */
#ifndef FMI2_TYPES_H
#define FMI2_TYPES_H

#include <stddef.h>

typedef void *fmi2Component;
typedef void *fmi2ComponentEnvironment;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Char;
typedef const fmi2Char *fmi2String;
typedef char fmi2Byte;

#define fmi2True 1
#define fmi2False 0

typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum {
    fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated
} fmi2StatusKind;

typedef struct {
    void (*logger)(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status,
                   fmi2String category, fmi2String message, ...);
    void *(*allocateMemory)(size_t count, size_t size);
    void (*freeMemory)(void *memory);
    void (*stepFinished)(fmi2ComponentEnvironment environment, fmi2Status status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

#if defined(_WIN32)
#define FMI2_EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define FMI2_EXPORT __attribute__((visibility("default")))
#else
#define FMI2_EXPORT
#endif

/* A library of its own has the plain names of the standard. Where several units are linked into one
   program, define FMI2_FUNCTION_PREFIX for each: it stands before the name of every function. */
#define FMI2_PASTE(a, b) a##b
#define FMI2_JOIN(a, b) FMI2_PASTE(a, b)
#ifdef FMI2_FUNCTION_PREFIX
#define FMI2_NAME(name) FMI2_JOIN(FMI2_FUNCTION_PREFIX, name)
#else
#define FMI2_NAME(name) name
#endif

#define FMI2_FUNCTION(result, name) FMI2_EXPORT result FMI2_NAME(name)

FMI2_FUNCTION(const char *, fmi2GetTypesPlatform)(void);
FMI2_FUNCTION(const char *, fmi2GetVersion)(void);
FMI2_FUNCTION(fmi2Status, fmi2SetDebugLogging)(fmi2Component, fmi2Boolean, size_t,
                                               const fmi2String[]);
FMI2_FUNCTION(fmi2Component, fmi2Instantiate)(fmi2String, fmi2Type, fmi2String, fmi2String,
                                              const fmi2CallbackFunctions *, fmi2Boolean,
                                              fmi2Boolean);
FMI2_FUNCTION(void, fmi2FreeInstance)(fmi2Component);
FMI2_FUNCTION(fmi2Status, fmi2SetupExperiment)(fmi2Component, fmi2Boolean, fmi2Real, fmi2Real,
                                               fmi2Boolean, fmi2Real);
FMI2_FUNCTION(fmi2Status, fmi2EnterInitializationMode)(fmi2Component);
FMI2_FUNCTION(fmi2Status, fmi2ExitInitializationMode)(fmi2Component);
FMI2_FUNCTION(fmi2Status, fmi2Terminate)(fmi2Component);
FMI2_FUNCTION(fmi2Status, fmi2Reset)(fmi2Component);

FMI2_FUNCTION(fmi2Status, fmi2GetReal)(fmi2Component, const fmi2ValueReference[], size_t,
                                       fmi2Real[]);
FMI2_FUNCTION(fmi2Status, fmi2GetInteger)(fmi2Component, const fmi2ValueReference[], size_t,
                                          fmi2Integer[]);
FMI2_FUNCTION(fmi2Status, fmi2GetBoolean)(fmi2Component, const fmi2ValueReference[], size_t,
                                          fmi2Boolean[]);
FMI2_FUNCTION(fmi2Status, fmi2GetString)(fmi2Component, const fmi2ValueReference[], size_t,
                                         fmi2String[]);
FMI2_FUNCTION(fmi2Status, fmi2SetReal)(fmi2Component, const fmi2ValueReference[], size_t,
                                       const fmi2Real[]);
FMI2_FUNCTION(fmi2Status, fmi2SetInteger)(fmi2Component, const fmi2ValueReference[], size_t,
                                          const fmi2Integer[]);
FMI2_FUNCTION(fmi2Status, fmi2SetBoolean)(fmi2Component, const fmi2ValueReference[], size_t,
                                          const fmi2Boolean[]);
FMI2_FUNCTION(fmi2Status, fmi2SetString)(fmi2Component, const fmi2ValueReference[], size_t,
                                         const fmi2String[]);

FMI2_FUNCTION(fmi2Status, fmi2GetFMUstate)(fmi2Component, fmi2FMUstate *);
FMI2_FUNCTION(fmi2Status, fmi2SetFMUstate)(fmi2Component, fmi2FMUstate);
FMI2_FUNCTION(fmi2Status, fmi2FreeFMUstate)(fmi2Component, fmi2FMUstate *);
FMI2_FUNCTION(fmi2Status, fmi2SerializedFMUstateSize)(fmi2Component, fmi2FMUstate, size_t *);
FMI2_FUNCTION(fmi2Status, fmi2SerializeFMUstate)(fmi2Component, fmi2FMUstate, fmi2Byte[], size_t);
FMI2_FUNCTION(fmi2Status, fmi2DeSerializeFMUstate)(fmi2Component, const fmi2Byte[], size_t,
                                                   fmi2FMUstate *);
FMI2_FUNCTION(fmi2Status, fmi2GetDirectionalDerivative)(fmi2Component, const fmi2ValueReference[],
                                                        size_t, const fmi2ValueReference[],
                                                        size_t, const fmi2Real[], fmi2Real[]);

FMI2_FUNCTION(fmi2Status, fmi2SetRealInputDerivatives)(fmi2Component, const fmi2ValueReference[],
                                                       size_t, const fmi2Integer[],
                                                       const fmi2Real[]);
FMI2_FUNCTION(fmi2Status, fmi2GetRealOutputDerivatives)(fmi2Component, const fmi2ValueReference[],
                                                        size_t, const fmi2Integer[], fmi2Real[]);
FMI2_FUNCTION(fmi2Status, fmi2DoStep)(fmi2Component, fmi2Real, fmi2Real, fmi2Boolean);
FMI2_FUNCTION(fmi2Status, fmi2CancelStep)(fmi2Component);
FMI2_FUNCTION(fmi2Status, fmi2GetStatus)(fmi2Component, const fmi2StatusKind, fmi2Status *);
FMI2_FUNCTION(fmi2Status, fmi2GetRealStatus)(fmi2Component, const fmi2StatusKind, fmi2Real *);
FMI2_FUNCTION(fmi2Status, fmi2GetIntegerStatus)(fmi2Component, const fmi2StatusKind,
                                                fmi2Integer *);
FMI2_FUNCTION(fmi2Status, fmi2GetBooleanStatus)(fmi2Component, const fmi2StatusKind,
                                                fmi2Boolean *);
FMI2_FUNCTION(fmi2Status, fmi2GetStringStatus)(fmi2Component, const fmi2StatusKind, fmi2String *);

#endif
