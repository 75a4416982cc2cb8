/* One instance of the model: its values, in which mode it is, and what may be asked of it in that mode.

   model.h, written at export, gives the numbers of states, inputs, parameters and outputs, their start values, and
   the equations.  All values stand in one array, and the index of a value there is its value reference:

       time | states | their rates | inputs | parameters | outputs

   An instance has no pointer into itself: to save or to send its state is to copy it.                               */

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model.h"

enum { TIME = 0, X = 1, DX = X + NX, U = DX + NX, P = U + NU, Y = P + NP, VALUES = Y + NY };

typedef enum { DONE, WARNING, DISCARD, ERROR } Status; /* as in both versions of the standard */

/* A call is allowed in a set of modes. */
typedef enum {
    INSTANTIATED = 1, INITIALIZATION = 2, EVENT = 4, CONTINUOUS = 8, STEP = 16, TERMINATED = 32,
    RUNNING = EVENT | CONTINUOUS | STEP,
    BEFORE_START = INSTANTIATED | INITIALIZATION,
    AFTER_START = INITIALIZATION | RUNNING | TERMINATED,
    ALWAYS = 63
} Mode;

typedef struct {
    Mode mode;
    int rates_known, outputs_known;
    double value[VALUES];
    double slope[NU + 1]; /* of the inputs, in a communication step */
    double tolerance;     /* of the integration, relative */
    double step, error;   /* proposed next step, and the logarithm of the last step's error */
} State;

typedef struct Instance Instance;
typedef void Report(const Instance *instance, Status status, const char *text);

struct Instance {
    State now;
    int co_simulation;
    int logging;
    char *name;
    void *environment;
    void (*logger)(void); /* of the importer, whose type only `report` knows */
    Report *report;
};

/* Tell the importer what is wrong, and return the status. */
static Status tell(const Instance *m, Status status, const char *format, ...)
{
    char text[256];
    va_list given;
    va_start(given, format);
    vsnprintf(text, sizeof text, format, given);
    va_end(given);
    if (m->report && m->logger && (m->logging || status >= ERROR)) m->report(m, status, text);
    return status;
}

static Status allowed(const Instance *m, int modes, const char *call)
{
    if (!m) return ERROR;
    return m->now.mode & modes ? DONE : tell(m, ERROR, "%s is not allowed in this mode (%d).", call, m->now.mode);
}

static void start(Instance *m)
{
    memset(&m->now, 0, sizeof m->now);
    memcpy(m->now.value, START, sizeof m->now.value);
    m->now.mode = INSTANTIATED;
    m->now.tolerance = RELATIVE_TOLERANCE;
}

static void discard(Instance *m)
{
    free(m->name);
    free(m);
}

/* Return a new instance, or NULL where the memory does not suffice. */
static Instance *create(const char *name, int co_simulation, int logging, void *environment, void (*logger)(void),
                        Report *report)
{
    Instance *m = calloc(1, sizeof *m);
    if (!m) return NULL;
    m->name = malloc(strlen(name) + 1);
    if (!m->name) { free(m); return NULL; }
    strcpy(m->name, name);
    m->co_simulation = co_simulation;
    m->logging = logging;
    m->environment = environment;
    m->logger = logger;
    m->report = report;
    start(m);
    return m;
}

static void changed(Instance *m) { m->now.rates_known = m->now.outputs_known = 0; }

/* Rates and outputs are computed when they are asked for. */
static void need_rates(Instance *m)
{
    double *v = m->now.value;
    if (!m->now.rates_known) model_rhs(v[TIME], v + X, v + U, v + P, v + DX);
    m->now.rates_known = 1;
}

static void need_outputs(Instance *m)
{
    double *v = m->now.value;
    if (!m->now.outputs_known) model_outputs(v[TIME], v + X, v + U, v + P, v + Y);
    m->now.outputs_known = 1;
}

static Status all_finite(const Instance *m, const double *values, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (!isfinite(values[i])) return tell(m, DISCARD, "A value is not finite at t = %g s.", m->now.value[TIME]);
    return DONE;
}

static Status get_values(Instance *m, const unsigned *references, size_t count, double *values)
{
    for (size_t i = 0; i < count; i++) {
        unsigned r = references[i];
        if (r >= VALUES) return tell(m, ERROR, "There is no real variable with the value reference %u.", r);
        if (r >= DX && r < U) need_rates(m);
        if (r >= Y) need_outputs(m);
        values[i] = m->now.value[r];
    }
    return all_finite(m, values, count);
}

/* Return the modes in which a variable can be set: none for what is computed. */
static int settable(unsigned r)
{
    if (r >= X && r < DX) return BEFORE_START;
    if (r >= U && r < P) return BEFORE_START | RUNNING;
    if (r >= P && r < Y) return BEFORE_START | EVENT | STEP;
    return 0;
}

static Status set_values(Instance *m, const unsigned *references, size_t count, const double *values)
{
    for (size_t i = 0; i < count; i++) {
        unsigned r = references[i];
        if (r >= VALUES) return tell(m, ERROR, "There is no real variable with the value reference %u.", r);
        if (!(settable(r) & m->now.mode))
            return tell(m, ERROR, "The variable with the value reference %u cannot be set now.", r);
        if (!isfinite(values[i])) return tell(m, ERROR, "The value for reference %u is not finite.", r);
    }
    for (size_t i = 0; i < count; i++) {
        m->now.value[references[i]] = values[i];
        if (references[i] >= U && references[i] < P) m->now.slope[references[i] - U] = 0.0;
    }
    changed(m);
    return DONE;
}

static Status set_states(Instance *m, const double *x, size_t count)
{
    if (count != NX) return tell(m, ERROR, "The model has %d continuous states, not %u.", NX, (unsigned)count);
    memcpy(m->now.value + X, x, NX * sizeof *x);
    changed(m);
    return DONE;
}

static Status get_states(Instance *m, double *x, size_t count)
{
    if (count != NX) return tell(m, ERROR, "The model has %d continuous states, not %u.", NX, (unsigned)count);
    memcpy(x, m->now.value + X, NX * sizeof *x);
    return DONE;
}

static Status get_nominals(Instance *m, double *nominals, size_t count)
{
    if (count != NX) return tell(m, ERROR, "The model has %d continuous states, not %u.", NX, (unsigned)count);
    memcpy(nominals, NOMINAL, NX * sizeof *nominals);
    return DONE;
}

static Status get_rates(Instance *m, double *rates, size_t count)
{
    if (count != NX) return tell(m, ERROR, "The model has %d continuous states, not %u.", NX, (unsigned)count);
    need_rates(m);
    memcpy(rates, m->now.value + DX, NX * sizeof *rates);
    return all_finite(m, rates, count);
}

static void set_time(Instance *m, double t)
{
    m->now.value[TIME] = t;
    changed(m);
}

/* Write the derivatives of unknowns (rates, outputs) along a direction in the knowns (states, inputs, parameters). */
static Status directional_derivative(Instance *m, const unsigned *unknowns, size_t n_unknowns, const unsigned *knowns,
                                     size_t n_knowns, const double *seed, double *result)
{
    double *v = m->now.value, along[VALUES] = {0.0};
    for (size_t i = 0; i < n_knowns; i++) {
        unsigned r = knowns[i];
        if (!(r >= X && r < DX) && !(r >= U && r < Y))
            return tell(m, ERROR, "Nothing is differentiated by the variable with the value reference %u.", r);
        along[r] = seed[i];
    }
    int rates = 0, outputs = 0;
    for (size_t i = 0; i < n_unknowns; i++) {
        if (unknowns[i] >= VALUES || unknowns[i] == TIME)
            return tell(m, ERROR, "The variable with the value reference %u has no derivatives.", unknowns[i]);
        rates |= unknowns[i] >= DX && unknowns[i] < U;
        outputs |= unknowns[i] >= Y;
    }
    if (rates) model_rhs_tangent(v[TIME], v + X, v + U, v + P, along + X, along + U, along + P, along + DX);
    if (outputs) model_outputs_tangent(v[TIME], v + X, v + U, v + P, along + X, along + U, along + P, along + Y);
    for (size_t i = 0; i < n_unknowns; i++) result[i] = along[unknowns[i]];
    return all_finite(m, result, n_unknowns);
}
