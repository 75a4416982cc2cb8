/* A thousand times: an instance that starts, steps, saves its state and puts it back, refuses a wrong step, and ends.

   Compiled with a unit's source: -DTOKEN_GIVEN='"{...}"', and -DSECOND for FMI 2.0.                                   */

#include <stdlib.h>
#ifdef SECOND
#include "fmi2Functions.h"

static void log_it(fmi2ComponentEnvironment e, fmi2String n, fmi2Status s, fmi2String c, fmi2String m, ...)
{
    (void)e, (void)n, (void)s, (void)c, (void)m;
}

static int cycle(void)
{
    static const fmi2CallbackFunctions callbacks = {log_it, calloc, free, NULL, NULL};
    fmi2Component c = fmi2Instantiate("one", fmi2CoSimulation, TOKEN_GIVEN, "", &callbacks, 0, 0);
    fmi2FMUstate saved = NULL;
    if (!c) return 1;
    if (fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0) || fmi2EnterInitializationMode(c)) return 2;
    if (fmi2ExitInitializationMode(c) || fmi2DoStep(c, 0.0, 1e-3, 1)) return 3;
    if (fmi2GetFMUstate(c, &saved) || fmi2SetFMUstate(c, saved) || fmi2FreeFMUstate(c, &saved)) return 4;
    if (fmi2DoStep(c, 9.0, 1e-3, 1) != fmi2Error || fmi2Terminate(c)) return 5;
    fmi2FreeInstance(c);
    return 0;
}
#else
#include "fmi3Functions.h"

static int cycle(void)
{
    fmi3Instance c =
        fmi3InstantiateCoSimulation("one", TOKEN_GIVEN, "", 0, 0, 0, 0, NULL, 0, NULL, NULL, NULL);
    fmi3FMUState saved = NULL;
    fmi3Boolean event, stop, early;
    fmi3Float64 last;
    if (!c) return 1;
    if (fmi3EnterInitializationMode(c, 0, 0.0, 0.0, 0, 0.0) || fmi3ExitInitializationMode(c)) return 2;
    if (fmi3DoStep(c, 0.0, 1e-3, 1, &event, &stop, &early, &last)) return 3;
    if (fmi3GetFMUState(c, &saved) || fmi3SetFMUState(c, saved) || fmi3FreeFMUState(c, &saved)) return 4;
    if (fmi3DoStep(c, 9.0, 1e-3, 1, &event, &stop, &early, &last) != fmi3Error || fmi3Terminate(c)) return 5;
    fmi3FreeInstance(c);
    return 0;
}
#endif

int main(void)
{
    for (int k = 0; k < 1000; k++) {
        int fault = cycle();
        if (fault) return fault;
    }
    return 0;
}
