"""What a user's call costs around the integration of the 37-state trip."""

from __future__ import annotations

from collections.abc import Callable

from trips import DURATION, reference_trip


def _simulate(**options):  # type: ignore[no-untyped-def]
    given = reference_trip()
    return given.system.simulate(
        DURATION, inputs=given.inputs, initial=given.start, times=given.times, rtol=1e-3, atol=1e-6, **options
    )


def bench_integration() -> Callable[[], None]:
    """integration alone (solve_ivp with samples at 1 kHz)"""
    from multibody.solvers import Automatic, integrate
    from multibody.system.simulate import native_problem

    given = reference_trip()
    problem = native_problem(given.system, given.system.p, given.table)

    def work() -> None:
        integrate(problem, (0.0, DURATION), given.start, t_eval=given.times, method=Automatic, rtol=1e-3, atol=1e-6)

    return work


def bench_simulate() -> Callable[[], None]:
    """System.simulate: inputs by name, largest step, trajectory"""
    return lambda: (_simulate(), None)[1]


def bench_equilibrium() -> Callable[[], None]:
    """static equilibrium"""
    from vtsdt.lift.lift import Lift

    lift = Lift.reference()
    return lambda: (lift.equilibrium(0.0), None)[1]


def bench_frame() -> Callable[[], None]:
    """all outputs of the trip as a DataFrame"""
    run = _simulate()

    def work() -> None:
        run.__dict__.pop("outputs", None)
        run.to_frame()

    return work


def bench_whole() -> Callable[[], None]:
    """the whole call: equilibrium, reference, trip, all outputs as a DataFrame"""
    from vtsdt.lift.lift import Lift

    lift = Lift.reference()
    return lambda: (lift.trip("up", rtol=1e-3, atol=1e-6).to_frame(), None)[1]
