/* The functions of FMI 3.0, Model Exchange and Co-Simulation. */

#include "fmi3Functions.h"

#include "instance.h"
#include "dormand_prince.h"

static const fmi3Status STATUS[] = {fmi3OK, fmi3Warning, fmi3Discard, fmi3Error};

#define CHECK(modes, call) \
    Instance *m = (Instance *)c; \
    if (allowed(m, modes, call) != DONE) return fmi3Error;
#define NEEDS(condition, call) \
    if (!(condition)) return STATUS[tell(m, ERROR, call ": an argument is missing, or a size is wrong.")];
#define REFUSED(call, why) \
    CHECK(ALWAYS, call) \
    return STATUS[tell(m, ERROR, call ": " why)];

static void report(const Instance *m, Status status, const char *text)
{
    ((fmi3LogMessageCallback)m->logger)(m->environment, STATUS[status], "logStatusError", text);
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t count, const fmi3String categories[])
{
    CHECK(ALWAYS, "fmi3SetDebugLogging")
    (void)count, (void)categories;
    m->logging = on;
    return fmi3OK;
}

/* ---------------------------------------------------------------- an instance and its modes */

static Instance *instantiate(fmi3String name, fmi3String token, int co_simulation, fmi3Boolean logging,
                             fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    if (!name || !*name || !token || strcmp(token, TOKEN)) {
        if (log)
            log(environment, fmi3Error, "logStatusError",
                "An instance needs a name and the instantiation token of the model description.");
        return NULL;
    }
    return create(name, co_simulation, logging, environment, (void (*)(void))log, report);
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log)
{
    (void)resources, (void)visible;
    return instantiate(name, token, 0, logging, environment, log);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
                                         const fmi3ValueReference intermediate[], size_t n_intermediate,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update)
{
    (void)resources, (void)visible, (void)early_return, (void)intermediate, (void)n_intermediate, (void)update;
    if (event_mode) {
        if (log) log(environment, fmi3Error, "logStatusError", "The model has no event mode in Co-Simulation.");
        return NULL;
    }
    return instantiate(name, token, 1, logging, environment, log);
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                               fmi3ClockUpdateCallback clock, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)clock, (void)lock, (void)unlock;
    if (log) log(environment, fmi3Error, "logStatusError", "The model has no Scheduled Execution.");
    return NULL;
}

void fmi3FreeInstance(fmi3Instance c)
{
    if (c) discard((Instance *)c);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                       fmi3Float64 start_time, fmi3Boolean has_stop, fmi3Float64 stop)
{
    CHECK(INSTANTIATED, "fmi3EnterInitializationMode")
    (void)has_stop, (void)stop;
    if (has_tolerance && tolerance > 0.0) m->now.tolerance = fmin(tolerance, RELATIVE_TOLERANCE);
    set_time(m, start_time);
    m->now.mode = INITIALIZATION;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    CHECK(INITIALIZATION, "fmi3ExitInitializationMode")
    m->now.mode = m->co_simulation ? STEP : EVENT;
    return fmi3OK;
}

fmi3Status fmi3EnterEventMode(fmi3Instance c)
{
    CHECK(EVENT | CONTINUOUS, "fmi3EnterEventMode")
    m->now.mode = EVENT;
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance c)
{
    CHECK(RUNNING, "fmi3Terminate")
    m->now.mode = TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance c)
{
    CHECK(ALWAYS, "fmi3Reset")
    start(m);
    return fmi3OK;
}

/* ---------------------------------------------------------------- values */

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[], size_t n_values)
{
    CHECK(ALWAYS, "fmi3GetFloat64")
    NEEDS(n == n_values && (!n || (vr && values)), "fmi3GetFloat64")
    return STATUS[get_values(m, vr, n, values)];
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 values[],
                          size_t n_values)
{
    CHECK(BEFORE_START | RUNNING, "fmi3SetFloat64")
    NEEDS(n == n_values && (!n || (vr && values)), "fmi3SetFloat64")
    return STATUS[set_values(m, vr, n, values)];
}

/* Every variable is a Float64. */
#define NO_VARIABLES(Type) \
    fmi3Status fmi3Get##Type(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3##Type values[], size_t k) \
    { \
        CHECK(ALWAYS, "fmi3Get" #Type) \
        (void)vr, (void)values, (void)k; \
        return n ? STATUS[tell(m, ERROR, "The model has no variables of type " #Type ".")] : fmi3OK; \
    } \
    fmi3Status fmi3Set##Type(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3##Type values[], \
                             size_t k) \
    { \
        CHECK(ALWAYS, "fmi3Set" #Type) \
        (void)vr, (void)values, (void)k; \
        return n ? STATUS[tell(m, ERROR, "The model has no variables of type " #Type ".")] : fmi3OK; \
    }
NO_VARIABLES(Float32)
NO_VARIABLES(Int8)
NO_VARIABLES(UInt8)
NO_VARIABLES(Int16)
NO_VARIABLES(UInt16)
NO_VARIABLES(Int32)
NO_VARIABLES(UInt32)
NO_VARIABLES(Int64)
NO_VARIABLES(UInt64)
NO_VARIABLES(Boolean)
NO_VARIABLES(String)

fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, size_t sizes[], fmi3Binary values[],
                         size_t k)
{
    (void)vr, (void)n, (void)sizes, (void)values, (void)k;
    REFUSED("fmi3GetBinary", "the model has no binary variables.")
}

fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const size_t sizes[],
                         const fmi3Binary values[], size_t k)
{
    (void)vr, (void)n, (void)sizes, (void)values, (void)k;
    REFUSED("fmi3SetBinary", "the model has no binary variables.")
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                        const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                        size_t n_seed, fmi3Float64 result[], size_t n_result)
{
    CHECK(INITIALIZATION | RUNNING | TERMINATED, "fmi3GetDirectionalDerivative")
    NEEDS(n_seed == n_knowns && n_result == n_unknowns, "fmi3GetDirectionalDerivative")
    NEEDS((!n_unknowns || (unknowns && result)) && (!n_knowns || (knowns && seed)), "fmi3GetDirectionalDerivative")
    return STATUS[directional_derivative(m, unknowns, n_unknowns, knowns, n_knowns, seed, result)];
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                    const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                    size_t n_seed, fmi3Float64 result[], size_t n_result)
{
    (void)unknowns, (void)n_unknowns, (void)knowns, (void)n_knowns;
    (void)seed, (void)n_seed, (void)result, (void)n_result;
    REFUSED("fmi3GetAdjointDerivative", "take directional derivatives.")
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference vr, size_t *count)
{
    (void)vr, (void)count;
    REFUSED("fmi3GetNumberOfVariableDependencies", "they are in the model description.")
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference dependent, size_t elements[],
                                       fmi3ValueReference independents[], size_t of_independents[],
                                       fmi3DependencyKind kinds[], size_t count)
{
    (void)dependent, (void)elements, (void)independents, (void)of_independents, (void)kinds, (void)count;
    REFUSED("fmi3GetVariableDependencies", "they are in the model description.")
}

/* ---------------------------------------------------------------- the state as a whole */

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *saved)
{
    CHECK(ALWAYS, "fmi3GetFMUState")
    NEEDS(saved, "fmi3GetFMUState")
    if (!*saved) *saved = malloc(sizeof(State));
    if (!*saved) return STATUS[tell(m, ERROR, "There is no memory for a state.")];
    memcpy(*saved, &m->now, sizeof(State));
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState saved)
{
    CHECK(ALWAYS, "fmi3SetFMUState")
    NEEDS(saved, "fmi3SetFMUState")
    memcpy(&m->now, saved, sizeof(State));
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *saved)
{
    CHECK(ALWAYS, "fmi3FreeFMUState")
    if (saved) {
        free(*saved);
        *saved = NULL;
    }
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState saved, size_t *size)
{
    CHECK(ALWAYS, "fmi3SerializedFMUStateSize")
    NEEDS(saved && size, "fmi3SerializedFMUStateSize")
    *size = sizeof(State);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState saved, fmi3Byte bytes[], size_t size)
{
    CHECK(ALWAYS, "fmi3SerializeFMUState")
    NEEDS(saved && bytes && size >= sizeof(State), "fmi3SerializeFMUState")
    memcpy(bytes, saved, sizeof(State));
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *saved)
{
    CHECK(ALWAYS, "fmi3DeserializeFMUState")
    NEEDS(saved && bytes && size == sizeof(State), "fmi3DeserializeFMUState")
    if (!*saved) *saved = malloc(sizeof(State));
    if (!*saved) return STATUS[tell(m, ERROR, "There is no memory for a state.")];
    memcpy(*saved, bytes, sizeof(State));
    return fmi3OK;
}

/* ---------------------------------------------------------------- events, of which the model has none of its own */

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *again, fmi3Boolean *terminate, fmi3Boolean *nominals,
                                    fmi3Boolean *values, fmi3Boolean *next_defined, fmi3Float64 *next)
{
    CHECK(EVENT, "fmi3UpdateDiscreteStates")
    NEEDS(again && terminate && nominals && values && next_defined && next, "fmi3UpdateDiscreteStates")
    *again = *terminate = *nominals = *values = *next_defined = fmi3False;
    *next = 0.0;
    return fmi3OK;
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c)
{
    CHECK(EVENT, "fmi3EvaluateDiscreteStates")
    return fmi3OK;
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance c)
{
    REFUSED("fmi3EnterConfigurationMode", "the model has no structural parameters.")
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance c)
{
    REFUSED("fmi3ExitConfigurationMode", "the model has no structural parameters.")
}

/* ---------------------------------------------------------------- Model Exchange */

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c)
{
    CHECK(EVENT, "fmi3EnterContinuousTimeMode")
    m->now.mode = CONTINUOUS;
    return fmi3OK;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean no_set_before, fmi3Boolean *event_mode,
                                       fmi3Boolean *terminate)
{
    CHECK(CONTINUOUS, "fmi3CompletedIntegratorStep")
    NEEDS(event_mode && terminate, "fmi3CompletedIntegratorStep")
    (void)no_set_before;
    *event_mode = *terminate = fmi3False;
    return fmi3OK;
}

fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 t)
{
    CHECK(EVENT | CONTINUOUS, "fmi3SetTime")
    set_time(m, t);
    return fmi3OK;
}

fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 x[], size_t n)
{
    CHECK(CONTINUOUS, "fmi3SetContinuousStates")
    NEEDS(!n || x, "fmi3SetContinuousStates")
    return STATUS[set_states(m, x, n)];
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 rates[], size_t n)
{
    CHECK(AFTER_START, "fmi3GetContinuousStateDerivatives")
    NEEDS(!n || rates, "fmi3GetContinuousStateDerivatives")
    return STATUS[get_rates(m, rates, n)];
}

fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 indicators[], size_t n)
{
    CHECK(AFTER_START, "fmi3GetEventIndicators")
    (void)indicators;
    return n ? STATUS[tell(m, ERROR, "The model has no event indicators.")] : fmi3OK;
}

fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n)
{
    CHECK(AFTER_START, "fmi3GetContinuousStates")
    NEEDS(!n || x, "fmi3GetContinuousStates")
    return STATUS[get_states(m, x, n)];
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 nominals[], size_t n)
{
    CHECK(ALWAYS, "fmi3GetNominalsOfContinuousStates")
    NEEDS(!n || nominals, "fmi3GetNominalsOfContinuousStates")
    return STATUS[get_nominals(m, nominals, n)];
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *count)
{
    CHECK(ALWAYS, "fmi3GetNumberOfEventIndicators")
    NEEDS(count, "fmi3GetNumberOfEventIndicators")
    *count = 0;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *count)
{
    CHECK(ALWAYS, "fmi3GetNumberOfContinuousStates")
    NEEDS(count, "fmi3GetNumberOfContinuousStates")
    *count = NX;
    return fmi3OK;
}

/* ---------------------------------------------------------------- Co-Simulation */

fmi3Status fmi3EnterStepMode(fmi3Instance c)
{
    REFUSED("fmi3EnterStepMode", "the model has no event mode in Co-Simulation.")
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Int32 orders[],
                                    fmi3Float64 values[], size_t n_values)
{
    (void)vr, (void)n, (void)orders, (void)values, (void)n_values;
    REFUSED("fmi3GetOutputDerivatives", "the model gives no derivatives of outputs.")
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 begin, fmi3Float64 size, fmi3Boolean no_set_before,
                      fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last_time)
{
    CHECK(STEP, "fmi3DoStep")
    NEEDS(event && terminate && early && last_time, "fmi3DoStep")
    (void)no_set_before;
    Status status = communication_step(m, begin, size);
    *event = *early = fmi3False;
    *terminate = status == DISCARD;
    *last_time = m->now.value[TIME];
    return STATUS[status];
}

/* ---------------------------------------------------------------- clocks, of which the model has none */

#define NO_CLOCKS(Name, ...) \
    fmi3Status fmi3##Name(fmi3Instance c, const fmi3ValueReference vr[], size_t n, __VA_ARGS__) \
    { \
        CHECK(ALWAYS, "fmi3" #Name) \
        (void)vr, (void)a, (void)b; \
        return n ? STATUS[tell(m, ERROR, "The model has no clocks.")] : fmi3OK; \
    }
#define NO_CLOCKS_1(Name, Value) \
    fmi3Status fmi3##Name(fmi3Instance c, const fmi3ValueReference vr[], size_t n, Value a[]) \
    { \
        CHECK(ALWAYS, "fmi3" #Name) \
        (void)vr, (void)a; \
        return n ? STATUS[tell(m, ERROR, "The model has no clocks.")] : fmi3OK; \
    }
NO_CLOCKS_1(GetClock, fmi3Clock)
NO_CLOCKS_1(SetClock, const fmi3Clock)
NO_CLOCKS_1(GetShiftDecimal, fmi3Float64)
NO_CLOCKS_1(SetShiftDecimal, const fmi3Float64)
NO_CLOCKS_1(SetIntervalDecimal, const fmi3Float64)
NO_CLOCKS(GetIntervalDecimal, fmi3Float64 a[], fmi3IntervalQualifier b[])
NO_CLOCKS(GetShiftFraction, fmi3UInt64 a[], fmi3UInt64 b[])
NO_CLOCKS(SetShiftFraction, const fmi3UInt64 a[], const fmi3UInt64 b[])
NO_CLOCKS(SetIntervalFraction, const fmi3UInt64 a[], const fmi3UInt64 b[])

fmi3Status fmi3GetIntervalFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[],
                                   fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
{
    CHECK(ALWAYS, "fmi3GetIntervalFraction")
    (void)vr, (void)counters, (void)resolutions, (void)qualifiers;
    return n ? STATUS[tell(m, ERROR, "The model has no clocks.")] : fmi3OK;
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time)
{
    (void)clock, (void)time;
    REFUSED("fmi3ActivateModelPartition", "the model has no clocks.")
}
