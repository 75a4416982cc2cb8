/* Dormand and Prince's method of order 5(4) as one writes it by hand: adaptive steps, dense output at given times.
 *
 * The rates of the model stand above this text; N is the number of states, N_U of inputs.  Inputs are a table of rows at
 * even times, interpolated linearly.
 */
#include <string.h>

static void inputs_at(double t, const double *table, long long rows, double spacing, double *u)
{
    double s = t / spacing;
    long long i = (long long)s;
    if (i < 0) i = 0;
    if (i > rows - 2) i = rows - 2;
    double z = s - (double)i;
    for (int j = 0; j < N_U; j++)
        u[j] = table[i * N_U + j] + z * (table[(i + 1) * N_U + j] - table[i * N_U + j]);
}

/* Integrates from 0 to the last of the times in steps of at most `largest` that end at the stops; returns the number of
 * evaluations, or -1. */
long long integrate(const double *x0, double *p, const double *table, long long rows, double spacing,
                    const double *times, long long count, double rtol, double atol, double largest,
                    const double *stops, long long stop_count, double *out)
{
    double y[N], new[N], k1[N], k2[N], k3[N], k4[N], k5[N], k6[N], k7[N], u[N_U > 0 ? N_U : 1];
    double t = 0.0, end = times[count - 1], h = 1e-5, last = 1e-4;
    long long next = 0, stop = 0, evaluations = 1;
#define RATES(at, state, rate) (inputs_at(at, table, rows, spacing, u), rhs(at, state, u, p, rate))
    memcpy(y, x0, sizeof y);
    RATES(0.0, y, k1);
    while (next < count && times[next] <= 0.0) memcpy(out + N * next++, y, sizeof y);
    while (t < end) {
        double kept = 0.0, target = end;
        if (h > largest) h = largest;
        while (stop < stop_count && stops[stop] <= t + 1e-14 * t) stop++;
        if (stop < stop_count && stops[stop] < end) target = stops[stop];
        if (t + 1.01 * h >= target) kept = h, h = target - t;
        else if (t + 2.0 * h > target) kept = h, h = 0.5 * (target - t);
        if (h < 1e-14) return -1;
        for (int i = 0; i < N; i++) new[i] = y[i] + h * (1.0 / 5) * k1[i];
        RATES(t + h / 5, new, k2);
        for (int i = 0; i < N; i++) new[i] = y[i] + h * ((3.0 / 40) * k1[i] + (9.0 / 40) * k2[i]);
        RATES(t + h * (3.0 / 10), new, k3);
        for (int i = 0; i < N; i++)
            new[i] = y[i] + h * ((44.0 / 45) * k1[i] - (56.0 / 15) * k2[i] + (32.0 / 9) * k3[i]);
        RATES(t + h * (4.0 / 5), new, k4);
        for (int i = 0; i < N; i++)
            new[i] = y[i] + h * ((19372.0 / 6561) * k1[i] - (25360.0 / 2187) * k2[i] + (64448.0 / 6561) * k3[i]
                                 - (212.0 / 729) * k4[i]);
        RATES(t + h * (8.0 / 9), new, k5);
        for (int i = 0; i < N; i++)
            new[i] = y[i] + h * ((9017.0 / 3168) * k1[i] - (355.0 / 33) * k2[i] + (46732.0 / 5247) * k3[i]
                                 + (49.0 / 176) * k4[i] - (5103.0 / 18656) * k5[i]);
        RATES(t + h, new, k6);
        for (int i = 0; i < N; i++)
            new[i] = y[i] + h * ((35.0 / 384) * k1[i] + (500.0 / 1113) * k3[i] + (125.0 / 192) * k4[i]
                                 - (2187.0 / 6784) * k5[i] + (11.0 / 84) * k6[i]);
        RATES(t + h, new, k7);
        evaluations += 6;
        double sum = 0.0;
        for (int i = 0; i < N; i++) {
            double e = h * ((71.0 / 57600) * k1[i] - (71.0 / 16695) * k3[i] + (71.0 / 1920) * k4[i]
                            - (17253.0 / 339200) * k5[i] + (22.0 / 525) * k6[i] - (1.0 / 40) * k7[i]);
            e /= atol + rtol * fmax(fabs(y[i]), fabs(new[i]));
            sum += e * e;
        }
        double error = sqrt(sum / N);
        if (!(error <= 1.0)) {
            h *= isfinite(error) ? fmax(0.2, 0.9 * pow(error, -0.17)) : 0.2;
            continue;
        }
        double reached = h == target - t ? target : t + h;
        while (next < count && times[next] <= reached) {
            double z = (times[next] - t) / h, z2 = z * z, z3 = z2 * z, z4 = z3 * z;
            double b1 = h * (z - (8048581381.0 / 2820520608) * z2 + (8663915743.0 / 2820520608) * z3
                             - (12715105075.0 / 11282082432) * z4);
            double b3 = h * ((131558114200.0 / 32700410799) * z2 - (68118460800.0 / 10900136933) * z3
                             + (87487479700.0 / 32700410799) * z4);
            double b4 = h * (-(1754552775.0 / 470086768) * z2 + (14199869525.0 / 1410260304) * z3
                             - (10690763975.0 / 1880347072) * z4);
            double b5 = h * ((127303824393.0 / 49829197408) * z2 - (318862633887.0 / 49829197408) * z3
                             + (701980252875.0 / 199316789632) * z4);
            double b6 = h * (-(282668133.0 / 205662961) * z2 + (2019193451.0 / 616988883) * z3
                             - (1453857185.0 / 822651844) * z4);
            double b7 = h * ((40617522.0 / 29380423) * z2 - (110615467.0 / 29380423) * z3 + (69997945.0 / 29380423) * z4);
            double *row = out + N * next++;
            for (int i = 0; i < N; i++)
                row[i] = y[i] + (b1 * k1[i] + b3 * k3[i] + b4 * k4[i] + b5 * k5[i] + b6 * k6[i] + b7 * k7[i]);
        }
        t = reached;
        memcpy(y, new, sizeof y);
        memcpy(k1, k7, sizeof k1);
        h *= fmin(10.0, fmax(0.2, 0.9 * pow(fmax(error, 1e-10), -0.17) * pow(last, 0.04)));
        if (h < kept) h = kept;
        last = fmax(error, 1e-4);
    }
    return evaluations;
}
