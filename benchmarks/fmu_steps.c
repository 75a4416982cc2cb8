/* The communication steps of a unit of FMI 2.0 in one call, by its own integrator or by a fixed Runge-Kutta of order 4. */

#include "fmi2.c"

static void rates_of(Instance *m, double begin, const double *given, double t, const double *x, double *rates)
{
    for (int i = 0; i < NU; i++) m->now.value[U + i] = given[i] + (t - begin) * m->now.slope[i];
    model_rhs(t, x, m->now.value + U, m->now.value + P, rates);
}

static void runge_kutta(Instance *m, const double *given, long count, double h)
{
    double *x = m->now.value + X, *t = &m->now.value[TIME], begin = *t, k[4][NX], y[NX];
    for (long j = 0; j < count; j++, *t += h) {
        rates_of(m, begin, given, *t, x, k[0]);
        for (int i = 0; i < NX; i++) y[i] = x[i] + 0.5 * h * k[0][i];
        rates_of(m, begin, given, *t + 0.5 * h, y, k[1]);
        for (int i = 0; i < NX; i++) y[i] = x[i] + 0.5 * h * k[1][i];
        rates_of(m, begin, given, *t + 0.5 * h, y, k[2]);
        for (int i = 0; i < NX; i++) y[i] = x[i] + h * k[2][i];
        rates_of(m, begin, given, *t + h, y, k[3]);
        for (int i = 0; i < NX; i++) x[i] += h / 6.0 * (k[0][i] + 2.0 * k[1][i] + 2.0 * k[2][i] + k[3][i]);
    }
}

/* Write the states at the end of each communication step, given the inputs at all of them.

   fixed: steps of Runge-Kutta in a communication step, 0 for the unit's integrator; sloped: inputs have derivatives. */
int all_steps(long count, double size, long fixed, int sloped, const double *inputs, double *states)
{
    Instance *m = create("one", 1, 0, NULL, NULL, NULL);
    if (!m) return 1;
    int status = 0;
    for (long n = 0; n < count && !status; n++) {
        memcpy(m->now.value + U, inputs + n * NU, NU * sizeof(double));
        for (int i = 0; i < NU; i++)
            m->now.slope[i] = sloped ? (inputs[(n + 1) * NU + i] - inputs[n * NU + i]) / size : 0.0;
        if (fixed) runge_kutta(m, inputs + n * NU, fixed, size / (double)fixed);
        else status = advance(m, (double)(n + 1) * size) != DONE;
        memcpy(states + n * NX, m->now.value + X, NX * sizeof(double));
    }
    discard(m);
    return status;
}
