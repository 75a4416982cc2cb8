/* A communication step by the Dormand-Prince pair of orders 5 and 4 with error control.

   Coefficients: Dormand and Prince (1980), J. Comput. Appl. Math. 6, 19-26; step control: Hairer, Norsett, Wanner,
   Solving Ordinary Differential Equations I, II.4, and II, IV.2.  Step for step as the simulation that the model comes
   from, at tolerances of its own: same first step, and no step in which a narrow feature (a rail joint, a gear tooth) passes by
   unseen.  Inputs run from the values that were set with the slopes that were set.                                  */

enum { STAGES = 7, LAST = STAGES - 1 };
static const double DAMPING = 0.04, EXPONENT = 0.2 - 0.75 * 0.04; /* of the step's controller */

static const double NODE[STAGES] = {0.0, 1.0 / 5, 3.0 / 10, 4.0 / 5, 8.0 / 9, 1.0, 1.0};
static const double WEIGHT[STAGES][LAST] = {
    {0.0},
    {1.0 / 5},
    {3.0 / 40, 9.0 / 40},
    {44.0 / 45, -56.0 / 15, 32.0 / 9},
    {19372.0 / 6561, -25360.0 / 2187, 64448.0 / 6561, -212.0 / 729},
    {9017.0 / 3168, -355.0 / 33, 46732.0 / 5247, 49.0 / 176, -5103.0 / 18656},
    {35.0 / 384, 0.0, 500.0 / 1113, 125.0 / 192, -2187.0 / 6784, 11.0 / 84},
};
static const double EMBEDDED[STAGES] = { /* difference to the method of order 4 */
    71.0 / 57600, 0.0, -71.0 / 16695, 71.0 / 1920, -17253.0 / 339200, 22.0 / 525, -1.0 / 40,
};

typedef struct {
    Instance *m;
    double begin;           /* of the communication step */
    double u_begin[NU + 1]; /* inputs then */
    double y[NX + 1];       /* states at the end of the trial step */
    double k[STAGES][NX + 1];
} Run;

static void inputs_at(Run *run, double t)
{
    State *s = &run->m->now;
    for (int i = 0; i < NU; i++) s->value[U + i] = run->u_begin[i] + (t - run->begin) * s->slope[i];
}

static void rates_at(Run *run, double t, const double *x, double *rates)
{
    State *s = &run->m->now;
    inputs_at(run, t);
    model_rhs(t, x, s->value + U, s->value + P, rates);
}

/* A tighter relative tolerance tightens the absolute one, too. */
static double allowed_error(const State *s, double a, double b)
{
    return s->tolerance * (ABSOLUTE_TOLERANCE / RELATIVE_TOLERANCE + fmax(fabs(a), fabs(b)));
}

/* Return the time in which something narrow passes by half of its width, at the speeds of a state. */
static double passing(Run *run, double t, const double *x)
{
    double shortest = LARGEST_STEP;
#if N_SPEEDS
    State *s = &run->m->now;
    double speed[N_SPEEDS];
    inputs_at(run, t);
    model_speeds(t, x, s->value + U, s->value + P, speed);
    for (int i = 0; i < N_SPEEDS; i++)
        if (0.5 * WIDTH[i] < fabs(speed[i]) * shortest) shortest = 0.5 * WIDTH[i] / fabs(speed[i]);
#else
    (void)run, (void)t, (void)x;
#endif
    return shortest;
}

/* Return a first step, from the size of the rates and of their change. */
static double first_step(Run *run, double longest)
{
    State *s = &run->m->now;
    double *x = s->value + X, t = s->value[TIME], d0 = 0.0, d1 = 0.0, d2 = 0.0;
    for (int i = 0; i < NX; i++) {
        double unit = allowed_error(s, x[i], x[i]);
        d0 += (x[i] / unit) * (x[i] / unit);
        d1 += (run->k[0][i] / unit) * (run->k[0][i] / unit);
    }
    d0 = sqrt(d0 / NX), d1 = sqrt(d1 / NX);
    double h = fmin(d0 >= 1e-5 && d1 >= 1e-5 ? 0.01 * d0 / d1 : 1e-6, longest);
    for (int i = 0; i < NX; i++) run->y[i] = x[i] + h * run->k[0][i];
    rates_at(run, t + h, run->y, run->k[1]);
    for (int i = 0; i < NX; i++) {
        double change = (run->k[1][i] - run->k[0][i]) / allowed_error(s, x[i], x[i]);
        d2 += change * change;
    }
    double steepest = fmax(d1, sqrt(d2 / NX) / h);
    double first = steepest > 1e-15 ? pow(0.01 / steepest, 1.0 / 6.0) : fmax(1e-6, 1e-3 * h);
    first = fmin(fmin(100.0 * h, first), longest);
    return isfinite(first) && first > 0.0 ? first : fmin(1e-6, longest);
}

/* Write the states after a step of size h, and return its error in units of what is allowed. */
static double try_step(Run *run, double h)
{
    State *s = &run->m->now;
    double *x = s->value + X, t = s->value[TIME], total = 0.0;
    for (int j = 1; j < STAGES; j++) {
        for (int i = 0; i < NX; i++) {
            double sum = 0.0;
            for (int l = 0; l < j; l++) sum += WEIGHT[j][l] * run->k[l][i];
            run->y[i] = x[i] + h * sum;
        }
        rates_at(run, t + NODE[j] * h, run->y, run->k[j]);
    }
    for (int i = 0; i < NX; i++) {
        double error = 0.0;
        for (int j = 0; j < STAGES; j++) error += EMBEDDED[j] * run->k[j][i];
        error *= h / allowed_error(s, x[i], run->y[i]);
        total += error * error;
    }
    return sqrt(total / NX);
}

/* Go on to a time; DISCARD, at the last good state, where no step is short enough. */
static Status advance(Instance *m, double end)
{
    State *s = &m->now;
    double *x = s->value + X, *t = &s->value[TIME];
    Run run = {.m = m, .begin = *t};
    memcpy(run.u_begin, s->value + U, NU * sizeof(double));
    changed(m);
    if (NX) rates_at(&run, *t, x, run.k[0]);
    if (NX && s->step == 0.0) s->step = first_step(&run, fmin(end - *t, LARGEST_STEP));
    double limit = INFINITY, proposal = NX ? fmin(s->step, passing(&run, *t, x)) : end - *t;
    Status status = DONE;
    while (NX && *t < end) {
        double remaining = end - *t, h = proposal;
        if (!(h >= 10.0 * 2.220446049250313e-16 * fabs(*t) + 1e-300)) {
            status = tell(m, DISCARD, "The integration stops at t = %g s: no step is short enough.", *t);
            break;
        }
        int last = 1.01 * h >= remaining, clipped = 2.0 * h > remaining; /* two equal steps beat a long and a short */
        if (last) h = remaining;
        else if (clipped) h = 0.5 * remaining;
        double error = try_step(&run, h);
        double near = error <= 1.0 ? passing(&run, *t + h, run.y) : 0.0;
        if (!(h <= 2.0 * near)) {
            limit = h;
            proposal = error <= 1.0 ? fmax(0.2 * h, near)
                : isfinite(error) ? h * fmax(0.2, 0.9 * pow(error, -EXPONENT)) : 0.2 * h;
            continue;
        }
        *t = last ? end : *t + h;
        memcpy(x, run.y, NX * sizeof *x);
        memcpy(run.k[0], run.k[LAST], NX * sizeof(double)); /* the last stage is the next step's first */
        double size = log(fmax(error, 1e-10)), factor = 0.9 * exp(DAMPING * s->error - EXPONENT * size);
        s->step = fmin(limit, fmax(clipped ? proposal : 0.0, h * fmin(10.0, fmax(0.2, factor))));
        s->error = fmax(size, log(1e-4)); /* the next step looks back no further */
        limit = INFINITY;
        proposal = fmin(s->step, passing(&run, *t, x));
    }
    if (!NX) *t = end;
    inputs_at(&run, *t);
    return status;
}

/* Take the communication step of the standard's doStep. */
static Status communication_step(Instance *m, double begin, double size)
{
    double t = m->now.value[TIME];
    if (!(size > 0.0) || !isfinite(size)) return tell(m, ERROR, "The communication step is %g s.", size);
    if (!(fabs(begin - t) <= 1e-9 * fmax(1.0, fabs(t))))
        return tell(m, ERROR, "The step begins at %g s, the model is at %g s.", begin, t);
    return advance(m, begin + size);
}
