"""The search in ten 6 s trips of the lift with 17 states: the whole of it.

Eight trips are for choosing and two are held out; some 150 candidates, free curves at every connection, and the
question whether what is left follows the inputs.  The aim is 30 s on two processors.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence


def _diagnosis(hidden: Sequence[str]) -> Callable[[], None]:
    from discrepancy.study.study import Study
    from vtsdt.rig.one_dimensional import PlainLiftRig

    case = PlainLiftRig(seed=11).case(hidden)

    def work() -> None:
        conclusion = Study(case.problem(seed=11)).diagnose()
        named = ", ".join(str(a.effect) for a in conclusion.accepted)
        work.note = f"{conclusion.verdict}: {named}" if named else conclusion.verdict  # type: ignore[attr-defined]

    work()
    return work


def bench_nothing_hidden() -> Callable[[], None]:
    """whole diagnosis, everything compiled, nothing hidden"""
    return _diagnosis([])


def bench_one_hidden() -> Callable[[], None]:
    """the same with one effect hidden"""
    return _diagnosis(["coulomb_friction@cabin.z"])
