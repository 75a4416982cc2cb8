/* The functions of FMI 2.0, Model Exchange and Co-Simulation. */

#include "fmi2Functions.h"

#include "instance.h"
#include "dormand_prince.h"

static const fmi2Status STATUS[] = {fmi2OK, fmi2Warning, fmi2Discard, fmi2Error};

#define CHECK(modes, call) \
    Instance *m = (Instance *)c; \
    if (allowed(m, modes, call) != DONE) return fmi2Error;
#define NEEDS(condition, call) \
    if (!(condition)) return STATUS[tell(m, ERROR, call ": an argument is missing.")];
#define KIND(is_co_simulation, call) \
    if (m->co_simulation != (is_co_simulation)) return STATUS[tell(m, ERROR, call " belongs to the other type.")];

static void report(const Instance *m, Status status, const char *text)
{
    ((fmi2CallbackLogger)m->logger)(m->environment, m->name, STATUS[status], "logStatusError", "%s", text);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count, const fmi2String categories[])
{
    CHECK(ALWAYS, "fmi2SetDebugLogging")
    (void)count, (void)categories;
    m->logging = on;
    return fmi2OK;
}

/* ---------------------------------------------------------------- an instance and its modes */

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)resources, (void)visible;
    if (!functions || !name || !*name || !guid || strcmp(guid, TOKEN)) {
        if (functions && functions->logger)
            functions->logger(functions->componentEnvironment, name ? name : "?", fmi2Error, "logStatusError",
                              "%s", "An instance needs a name and the GUID of the model description.");
        return NULL;
    }
    return create(name, type == fmi2CoSimulation, logging, functions->componentEnvironment,
                  (void (*)(void))functions->logger, report);
}

void fmi2FreeInstance(fmi2Component c)
{
    if (c) discard((Instance *)c);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start_time,
                               fmi2Boolean has_stop, fmi2Real stop)
{
    CHECK(INSTANTIATED, "fmi2SetupExperiment")
    (void)has_stop, (void)stop;
    if (has_tolerance && tolerance > 0.0) m->now.tolerance = fmin(tolerance, RELATIVE_TOLERANCE);
    set_time(m, start_time);
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    CHECK(INSTANTIATED, "fmi2EnterInitializationMode")
    m->now.mode = INITIALIZATION;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    CHECK(INITIALIZATION, "fmi2ExitInitializationMode")
    m->now.mode = m->co_simulation ? STEP : EVENT;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    CHECK(RUNNING, "fmi2Terminate")
    m->now.mode = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    CHECK(ALWAYS, "fmi2Reset")
    start(m);
    return fmi2OK;
}

/* ---------------------------------------------------------------- values */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    CHECK(ALWAYS, "fmi2GetReal")
    NEEDS(!n || (vr && value), "fmi2GetReal")
    return STATUS[get_values(m, vr, n, value)];
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    CHECK(BEFORE_START | RUNNING, "fmi2SetReal")
    NEEDS(!n || (vr && value), "fmi2SetReal")
    return STATUS[set_values(m, vr, n, value)];
}

/* Every variable is real. */
#define NO_VARIABLES(Type) \
    fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2##Type value[]) \
    { \
        CHECK(ALWAYS, "fmi2Get" #Type) \
        (void)vr, (void)value; \
        return n ? STATUS[tell(m, ERROR, "The model has no variables of type " #Type ".")] : fmi2OK; \
    } \
    fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2##Type value[]) \
    { \
        CHECK(ALWAYS, "fmi2Set" #Type) \
        (void)vr, (void)value; \
        return n ? STATUS[tell(m, ERROR, "The model has no variables of type " #Type ".")] : fmi2OK; \
    }
NO_VARIABLES(Integer)
NO_VARIABLES(Boolean)
NO_VARIABLES(String)

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n_unknown,
                                        const fmi2ValueReference known[], size_t n_known, const fmi2Real seed[],
                                        fmi2Real result[])
{
    CHECK(INITIALIZATION | RUNNING | TERMINATED, "fmi2GetDirectionalDerivative")
    NEEDS((!n_unknown || (unknown && result)) && (!n_known || (known && seed)), "fmi2GetDirectionalDerivative")
    return STATUS[directional_derivative(m, unknown, n_unknown, known, n_known, seed, result)];
}

/* ---------------------------------------------------------------- the state as a whole */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *saved)
{
    CHECK(ALWAYS, "fmi2GetFMUstate")
    NEEDS(saved, "fmi2GetFMUstate")
    if (!*saved) *saved = malloc(sizeof(State));
    if (!*saved) return STATUS[tell(m, ERROR, "There is no memory for a state.")];
    memcpy(*saved, &m->now, sizeof(State));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate saved)
{
    CHECK(ALWAYS, "fmi2SetFMUstate")
    NEEDS(saved, "fmi2SetFMUstate")
    memcpy(&m->now, saved, sizeof(State));
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *saved)
{
    CHECK(ALWAYS, "fmi2FreeFMUstate")
    if (saved) {
        free(*saved);
        *saved = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate saved, size_t *size)
{
    CHECK(ALWAYS, "fmi2SerializedFMUstateSize")
    NEEDS(saved && size, "fmi2SerializedFMUstateSize")
    *size = sizeof(State);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate saved, fmi2Byte bytes[], size_t size)
{
    CHECK(ALWAYS, "fmi2SerializeFMUstate")
    NEEDS(saved && bytes && size >= sizeof(State), "fmi2SerializeFMUstate")
    memcpy(bytes, saved, sizeof(State));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *saved)
{
    CHECK(ALWAYS, "fmi2DeSerializeFMUstate")
    NEEDS(saved && bytes && size == sizeof(State), "fmi2DeSerializeFMUstate")
    if (!*saved) *saved = malloc(sizeof(State));
    if (!*saved) return STATUS[tell(m, ERROR, "There is no memory for a state.")];
    memcpy(*saved, bytes, sizeof(State));
    return fmi2OK;
}

/* ---------------------------------------------------------------- Model Exchange */

fmi2Status fmi2EnterEventMode(fmi2Component c)
{
    CHECK(EVENT | CONTINUOUS, "fmi2EnterEventMode")
    m->now.mode = EVENT;
    return fmi2OK;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    CHECK(EVENT, "fmi2NewDiscreteStates")
    NEEDS(info, "fmi2NewDiscreteStates")
    memset(info, 0, sizeof *info);
    return fmi2OK;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    CHECK(EVENT, "fmi2EnterContinuousTimeMode")
    m->now.mode = CONTINUOUS;
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no_set_before, fmi2Boolean *event_mode,
                                       fmi2Boolean *terminate)
{
    CHECK(CONTINUOUS, "fmi2CompletedIntegratorStep")
    NEEDS(event_mode && terminate, "fmi2CompletedIntegratorStep")
    (void)no_set_before;
    *event_mode = *terminate = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real t)
{
    CHECK(EVENT | CONTINUOUS, "fmi2SetTime")
    set_time(m, t);
    return fmi2OK;
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n)
{
    CHECK(CONTINUOUS, "fmi2SetContinuousStates")
    NEEDS(!n || x, "fmi2SetContinuousStates")
    return STATUS[set_states(m, x, n)];
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real rates[], size_t n)
{
    CHECK(AFTER_START, "fmi2GetDerivatives")
    NEEDS(!n || rates, "fmi2GetDerivatives")
    return STATUS[get_rates(m, rates, n)];
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real indicators[], size_t n)
{
    CHECK(AFTER_START, "fmi2GetEventIndicators")
    (void)indicators;
    return n ? STATUS[tell(m, ERROR, "The model has no event indicators.")] : fmi2OK;
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n)
{
    CHECK(AFTER_START, "fmi2GetContinuousStates")
    NEEDS(!n || x, "fmi2GetContinuousStates")
    return STATUS[get_states(m, x, n)];
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominals[], size_t n)
{
    CHECK(ALWAYS, "fmi2GetNominalsOfContinuousStates")
    NEEDS(!n || nominals, "fmi2GetNominalsOfContinuousStates")
    return STATUS[get_nominals(m, nominals, n)];
}

/* ---------------------------------------------------------------- Co-Simulation */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    CHECK(BEFORE_START | STEP, "fmi2SetRealInputDerivatives")
    KIND(1, "fmi2SetRealInputDerivatives")
    NEEDS(!n || (vr && order && value), "fmi2SetRealInputDerivatives")
    for (size_t i = 0; i < n; i++)
        if (vr[i] < U || vr[i] >= P || order[i] != 1 || !isfinite(value[i]))
            return STATUS[tell(m, ERROR, "Inputs have first derivatives, the variable %u has none.", vr[i])];
    for (size_t i = 0; i < n; i++) m->now.slope[vr[i] - U] = value[i];
    return fmi2OK;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[])
{
    CHECK(ALWAYS, "fmi2GetRealOutputDerivatives")
    (void)vr, (void)n, (void)order, (void)value;
    return STATUS[tell(m, ERROR, "The model gives no derivatives of outputs.")];
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real begin, fmi2Real size, fmi2Boolean no_set_before)
{
    CHECK(STEP, "fmi2DoStep")
    (void)no_set_before;
    return STATUS[communication_step(m, begin, size)];
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    CHECK(ALWAYS, "fmi2CancelStep")
    return STATUS[tell(m, ERROR, "Steps are not asynchronous: there is none to cancel.")];
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    CHECK(STEP | TERMINATED, "fmi2GetRealStatus")
    NEEDS(value, "fmi2GetRealStatus")
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = m->now.value[TIME];
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    CHECK(STEP | TERMINATED, "fmi2GetBooleanStatus")
    NEEDS(value, "fmi2GetBooleanStatus")
    if (kind != fmi2Terminated) return fmi2Discard;
    *value = fmi2True; /* asked after a step that was discarded: no step is short enough to go on */
    return fmi2OK;
}

#define NO_STATUS(Type, Value) \
    fmi2Status fmi2Get##Type(fmi2Component c, const fmi2StatusKind kind, Value *value) \
    { \
        CHECK(STEP | TERMINATED, "fmi2Get" #Type) \
        (void)kind, (void)value; \
        return fmi2Discard; \
    }
NO_STATUS(Status, fmi2Status)
NO_STATUS(IntegerStatus, fmi2Integer)
NO_STATUS(StringStatus, fmi2String)
