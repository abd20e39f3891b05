
/* FMI 2.0 by the functions of FMI 3.0 above. */

typedef void *fmi2Component, *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef char fmi2Char, fmi2Byte;
typedef const fmi2Char* fmi2String;
typedef enum {
  fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending
} fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef struct {
  fmi2Boolean newDiscreteStatesNeeded, terminateSimulation, nominalsOfContinuousStatesChanged,
      valuesOfContinuousStatesChanged, nextEventTimeDefined;
  fmi2Real nextEventTime;
} fmi2EventInfo;

/* statuses up to `fatal` have the same numbers */
#define F2 FMI3_Export fmi2Status

FMI3_Export const char* fmi2GetTypesPlatform(void) { return "default"; }
FMI3_Export const char* fmi2GetVersion(void) { return "2.0"; }
FMI3_Export fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid,
                                          fmi2String resources, const void* callbacks,
                                          fmi2Boolean visible, fmi2Boolean logging) {
  casadi_fmi_memory* m = (casadi_fmi_memory*)fmi3InstantiateModelExchange(
      name, guid, resources, visible != 0, logging != 0, 0, 0);
  if (m) fmi3EnterInitializationMode(m, 0, 0, 0, 0, 0);
  return m;
}
FMI3_Export void fmi2FreeInstance(fmi2Component c) { fmi3FreeInstance(c); }
F2 fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) {
  return fmi2OK;
}
F2 fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerated, fmi2Real tolerance, fmi2Real start,
                       fmi2Boolean stops, fmi2Real stop) {
  return (fmi2Status)fmi3EnterInitializationMode(c, tolerated != 0, tolerance, start, stops != 0,
                                                 stop);
}
F2 fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
F2 fmi2ExitInitializationMode(fmi2Component c) { return fmi2OK; }
F2 fmi2Terminate(fmi2Component c) { return fmi2OK; }
F2 fmi2Reset(fmi2Component c) {
  fmi3Reset(c);
  return (fmi2Status)fmi3EnterInitializationMode(c, 0, 0, 0, 0, 0);
}

F2 fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
  return (fmi2Status)fmi3GetFloat64(c, vr, n, value, n);
}
F2 fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
  return (fmi2Status)fmi3SetFloat64(c, vr, n, value, n);
}
/* all variables are real */
#define NONE(type)                                                                              \
  F2 fmi2Get##type(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2##type v[]) {  \
    return n ? fmi2Error : fmi2OK;                                                              \
  }                                                                                             \
  F2 fmi2Set##type(fmi2Component c, const fmi2ValueReference vr[], size_t n,                    \
                   const fmi2##type v[]) {                                                      \
    return n ? fmi2Error : fmi2OK;                                                              \
  }
NONE(Integer)
NONE(Boolean)
NONE(String)
F2 fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n,
                                const fmi2ValueReference known[], size_t m, const fmi2Real seed[],
                                fmi2Real sensitivity[]) {
  return (fmi2Status)fmi3GetDirectionalDerivative(c, unknown, n, known, m, seed, m, sensitivity, n);
}

F2 fmi2GetFMUstate(fmi2Component c, fmi2FMUstate* state) {
  return (fmi2Status)fmi3GetFMUState(c, state);
}
F2 fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
  return (fmi2Status)fmi3SetFMUState(c, state);
}
F2 fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate* state) {
  return (fmi2Status)fmi3FreeFMUState(c, state);
}
F2 fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t* size) {
  return fmi2Error;
}
F2 fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte into[], size_t size) {
  return fmi2Error;
}
F2 fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte from[], size_t size,
                           fmi2FMUstate* state) {
  return fmi2Error;
}

/* model exchange: there are no events */
F2 fmi2EnterEventMode(fmi2Component c) { return fmi2OK; }
F2 fmi2EnterContinuousTimeMode(fmi2Component c) { return fmi2OK; }
F2 fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo* info) {
  memset(info, 0, sizeof(*info));
  return fmi2OK;
}
F2 fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean noStateSetBefore, fmi2Boolean* event,
                               fmi2Boolean* terminate) {
  *event = *terminate = 0;
  return fmi2OK;
}
F2 fmi2SetTime(fmi2Component c, fmi2Real time) { return (fmi2Status)fmi3SetTime(c, time); }
F2 fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) {
  return (fmi2Status)fmi3SetContinuousStates(c, x, n);
}
F2 fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
  return (fmi2Status)fmi3GetContinuousStates(c, x, n);
}
F2 fmi2GetDerivatives(fmi2Component c, fmi2Real rates[], size_t n) {
  return (fmi2Status)fmi3GetContinuousStateDerivatives(c, rates, n);
}
F2 fmi2GetEventIndicators(fmi2Component c, fmi2Real indicators[], size_t n) {
  return n ? fmi2Error : fmi2OK;
}
F2 fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real sizes[], size_t n) {
  return (fmi2Status)fmi3GetNominalsOfContinuousStates(c, sizes, n);
}

/* co-simulation: steps never pause */
F2 fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean noStateSetBefore) {
  return (fmi2Status)step_to((casadi_fmi_memory*)c, time, time + step);
}
F2 fmi2CancelStep(fmi2Component c) { return fmi2Error; }
F2 fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                               const fmi2Integer order[], const fmi2Real value[]) {
  return n ? fmi2Error : fmi2OK;
}
F2 fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                const fmi2Integer order[], fmi2Real value[]) {
  return n ? fmi2Error : fmi2OK;
}
F2 fmi2GetStatus(fmi2Component c, int kind, fmi2Status* value) { return fmi2Discard; }
F2 fmi2GetRealStatus(fmi2Component c, int kind, fmi2Real* value) { return fmi2Discard; }
F2 fmi2GetIntegerStatus(fmi2Component c, int kind, fmi2Integer* value) { return fmi2Discard; }
F2 fmi2GetBooleanStatus(fmi2Component c, int kind, fmi2Boolean* value) { return fmi2Discard; }
F2 fmi2GetStringStatus(fmi2Component c, int kind, fmi2String* value) { return fmi2Discard; }
