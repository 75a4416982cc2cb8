"""How a model is confronted with its records: by simulation, window by window, or with the motion given.

See docs/method/residuals.md.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.problem.problem import Problem
from discrepancy.residual.free_rotations import free_rotations
from discrepancy.residual.initial_state import Followed, follow
from discrepancy.residual.noisy_inputs import NoisyInput, reduce_input_noise
from discrepancy.residual.windows import (
    FACTOR,
    LEAST_SAMPLES,
    NOISE_FACTOR,
    WINDOW_FACTOR,
    Growth,
    crop,
    cut_windows,
    divergence_time,
    growth_from,
    keeps_growing,
    samples_needed,
)
from multibody.base.parallel import side_by_side
from multibody.base.progress import silent

if TYPE_CHECKING:
    from estimation.response.experiment import Experiment
    from multibody.machine.model import System

__all__ = ["PreparedProblem", "prepared_problem", "problem_in_windows"]

LOST = 0.01 * FACTOR
"""Share of an output's spread from which a calibrated simulation does not follow its records, as one that runs away.
What a scan, which is linear in the error, says about it is worth nothing."""


@dataclass(frozen=True, eq=False)
class PreparedProblem:
    """A study's problem in the form in which it is worked on.

    Parameters
    ----------
    problem : Problem
        With the experiments (and, in inverse mode, the model) that the residual is taken from.
    mode : {"simulation", "prediction", "inverse"}
    reason : str
        One sentence.
    noisy : tuple of NoisyInput
        Recorded inputs that simulations use low-passed, because their noise matters.
    """

    problem: Problem
    mode: str
    reason: str
    noisy: tuple[NoisyInput, ...] = ()


def prepared_problem(problem: Problem, progress: Callable[[str], None] = silent) -> PreparedProblem:
    """Choose how to confront a model with its records, and prepare the experiments for it.

    Parameters
    ----------
    problem : Problem
        ``problem.residual`` asks for a mode, or is ``"auto"``.
    progress : callable
        Gets a line of text now and then.

    Raises
    ------
    StudyError
        If the inverse residual is asked for and no position, angle or speed of a free motion is measured.
    SimulationError
        If the machine cannot be simulated at all.
    """
    found = _chosen(problem, progress)
    # windows weigh the noise of inputs, and a given motion has its own low-pass
    if found.mode != "simulation" or problem.inputs == "as recorded":
        return found
    quiet, noisy = reduce_input_noise(found.problem, progress)
    return replace(found, problem=quiet, noisy=noisy)


def _chosen(problem: Problem, progress: Callable[[str], None]) -> PreparedProblem:
    """Return the mode that the study asks for, or that suits the machine."""
    if problem.residual == "simulation":
        return PreparedProblem(problem, "simulation", "asked for by the study")
    if problem.residual == "inverse":
        from discrepancy.residual.inverse import inverse_problem

        progress("give the machine its recorded motion")
        found = inverse_problem(problem)
        return PreparedProblem(found.problem, "inverse", f"asked for by the study; {found.told}")
    progress("how fast the machine runs away from a start that is slightly off")
    if problem.residual == "auto":  # two records tell a machine that stays where it is put, which most do
        whole = _Look.of(problem, telling_only=True).whole()
        if not np.isfinite(whole.within) and not _feels_inputs(whole):
            return PreparedProblem(problem, "simulation", _stays(whole))
    look = _Look.of(problem)
    whole = look.whole()
    if problem.residual == "auto" and not np.isfinite(whole.within):
        return PreparedProblem(problem, "simulation", _stays(whole))
    length = look.length()
    least = max(samples_needed(e.preparation, e.record.rate) / e.record.rate for e in look.identify)
    if length < least and problem.residual == "auto":
        inverse = _inverse_instead(problem, length)
        if inverse is not None:
            return inverse
    progress(f"cut the records into windows of at most {max(length, least):.3g} s")
    windowed, count = look.windowed(length)
    reason = f"{_runs_away(whole)}; the records are cut into {count} windows, most of about {max(length, least):.2g} s"
    if length < least:
        reason += f", the least that leaves {LEAST_SAMPLES} samples (errors grow within {length:.2g} s: record faster)"
    if problem.residual == "prediction":
        reason = f"asked for by the study; {reason}"
    return PreparedProblem(windowed, "prediction", reason)


def problem_in_windows(
    problem: Problem, errors: Mapping[str, float] | None = None, progress: Callable[[str], None] = silent
) -> PreparedProblem | None:
    """Return the problem cut into windows, where calibrated simulations of whole records do not follow them.

    Parameters
    ----------
    problem : Problem
        As handed in.
    errors : mapping of str to float, optional
        Root mean square error of each output after calibration, SI; None cuts in any case.
    progress : callable

    Returns
    -------
    PreparedProblem or None
        None where the simulations follow, and where windows would be as long as the records: the machine does not run
        away from its start, it is the model that is wrong.
    """
    if errors is not None and _surely_follow(problem, errors):
        return None
    look = _Look.of(problem)
    reason = "as before"
    if errors is not None:
        shares = {n: errors[n] / s for n, s in zip(look.identify[0].outputs, look.spread, strict=True)}
        worst = max(shares, key=lambda n: shares[n])
        if not shares[worst] > LOST:
            return None
        reason = f"simulations of whole records end {shares[worst]:.0%} of the spread of {worst} away from them"
    length = look.length()
    least = max(samples_needed(e.preparation, e.record.rate) / e.record.rate for e in look.identify)
    if max(length, least) > 0.5 * max(e.record.duration for e in look.identify):
        return None
    progress(f"cut the records into windows of at most {max(length, least):.3g} s: {reason}")
    windowed, count = look.windowed(length)
    told = f"{reason}, and show nothing that is missing: the records are cut into {count} windows"
    return PreparedProblem(windowed, "prediction", f"{told}, most of about {max(length, least):.2g} s")


def _spread_of(experiments: Sequence[Experiment]) -> np.ndarray:
    """Return the standard deviation of each output over all records, SI; never quite zero."""
    values = np.concatenate([e.record.values(*e.outputs) for e in experiments])
    return np.maximum(np.std(values, axis=0), 1e-9 * np.maximum(np.max(np.abs(values), axis=0), 1e-300))


def _surely_follow(problem: Problem, errors: Mapping[str, float]) -> bool:
    """Tell whether the errors are small against every spread that an output may have: then no simulation is needed."""
    experiments = tuple(crop(e) for e in problem.identify)
    for name, spread in zip(experiments[0].outputs, _spread_of(experiments), strict=True):
        angle = experiments[0].record.signals[name].unit in ("rad", "")  # of one that counts no turns 1 rad at most
        if errors[name] > LOST * (min(spread, 1.0) if angle else spread):
            return False
    return True


@dataclass(frozen=True, eq=False)
class _Look:
    """A problem's records with the states that the machine had along them."""

    problem: Problem
    system: System
    p: np.ndarray
    identify: tuple[Experiment, ...]
    followed: tuple[Followed, ...]
    spread: np.ndarray
    scale: np.ndarray

    @classmethod
    def of(cls, problem: Problem, *, telling_only: bool = False) -> _Look:
        experiments = tuple(crop(e) for e in problem.identify)
        system = problem.model.build(outputs=experiments[0].outputs)
        p = system.parameter_vector({q.name: q.value for q in problem.uncertain})
        spread = _spread_of(experiments)
        units = np.array([system.unit(n) for n in experiments[0].outputs])
        if telling_only:
            wide = [float(np.max(np.ptp(e.record.values(*e.outputs), axis=0) / spread)) for e in experiments]
            longest = int(np.argmax([e.record.duration for e in experiments]))
            experiments = tuple(experiments[i] for i in dict.fromkeys((longest, int(np.argmax(wide)))))
        followed = tuple(side_by_side(lambda e: follow(e, system, p), experiments))
        scale = np.std(np.concatenate([f.states for f in followed]), axis=0)
        # A turn more makes no angle less exact, unless it is one of those that only count turns.
        turns, counted = free_rotations(system, p, experiments, followed)
        spread = np.where((units == "rad") & ~counted, np.minimum(spread, 1.0), spread)
        angles = np.array([q.unit == "rad" for q in system.states], dtype=bool)
        scale = np.where(angles & ~turns, np.minimum(scale, 1.0), scale)
        return cls(problem, system, p, experiments, followed, spread, scale)

    def whole(self) -> Growth:
        """Return how errors grow over the record in which they grow the soonest, or the farthest."""
        found = side_by_side(self._over, range(len(self.identify)))
        return min(found, key=lambda g: (g.within, -float(np.max(g.start))))

    def _over(self, i: int) -> Growth:
        growth = growth_from(self.identify[i], self.system, self.p, self.followed[i], 0, self.spread, self.scale)
        cut = growth.time[-1] < 0.99 * self.identify[i].record.duration
        if cut:  # the simulation broke off: errors beyond all bounds at its end
            start = growth.start.copy()
            start[-1] = np.inf
            growth = replace(growth, start=start)
        return growth

    def length(self) -> float:
        """Return the longest window over which errors stay small, s."""
        return divergence_time(self.identify, self.system, self.p, self.followed, self.spread, self.scale)

    def windowed(self, length: float) -> tuple[Problem, int]:
        """Return the problem with every record cut into windows, and how many there are for choosing."""
        identify = self._cut(self.identify, self.followed, length)
        held = [crop(e) for e in self.problem.validate]
        validate = self._cut(held, [follow(e, self.system, self.p) for e in held], length)
        return replace(self.problem, identify=identify, validate=validate), len(identify)

    def _cut(
        self, experiments: Sequence[Experiment], followed: Sequence[Followed], length: float
    ) -> tuple[Experiment, ...]:
        return tuple(
            w
            for e, f in zip(experiments, followed, strict=True)
            for w in cut_windows(e, self.system, self.p, f, length, self.spread, self.scale)
        )


def _inverse_instead(problem: Problem, length: float) -> PreparedProblem | None:
    from discrepancy.problem.study_file import StudyError
    from discrepancy.residual.inverse import inverse_problem

    try:
        found = inverse_problem(problem)
    except StudyError:
        return None
    return PreparedProblem(
        found.problem,
        "inverse",
        f"errors grow {WINDOW_FACTOR:.0f} times within {length:.2g} s, too short a time for windows of "
        f"{LEAST_SAMPLES} samples; {found.told}",
    )


def _stays(growth: Growth) -> str:
    most = float(np.max(growth.start))
    if most < 1.5:
        told = "an error of the start does not grow"
    else:
        told = f"a start 1 % off moves no output by more than {most:.2g} % of its spread"
    return (
        f"over {growth.time[-1]:.3g} s {told}: the machine stays where its inputs put it, so a simulation of "
        "the whole record says most"
    )


def _runs_away(growth: Growth) -> str:
    """Say which error grows, how far, and within which time."""
    if not np.isfinite(growth.within):
        return f"a simulation of the whole record would do (errors grow less than {FACTOR:.0f} times in it)"
    beyond = growth.start > FACTOR
    if np.any(beyond):
        most = next((f for f in (10.0 * FACTOR, FACTOR) if np.any(growth.start > f)), FACTOR)
        when = float(growth.time[np.argmax(growth.start > most)])
        return f"a start 1 % off grows {most:.0f} times within {when:.2g} s, so no simulation follows a whole record"
    if _reaches(growth.inputs):
        return (
            f"an error of 1 % of {growth.input_name} moves {growth.output_name} by {growth.input_change:.2g} (SI) "
            f"within {growth.time[-1]:.2g} s and ever further, so no simulation follows a whole record"
        )
    name, output, size = growth.noisy
    return (
        f"the noise of {name} alone adds up to {size:.2g} (SI) in {output} within {growth.time[-1]:.2g} s, "
        f"{growth.noise[-1]:.0f} times that output's own noise, so no simulation follows a whole record"
    )


def _feels_inputs(growth: Growth) -> bool:
    """Tell whether a slight error of an input, or its noise, moves outputs far, though it settles in these records.

    A cabin that stands on its guides at the end of one trip feels its rope no more; in the next it moves on.
    """
    noise = float(np.max(growth.noise, initial=0.0))
    return float(np.max(growth.inputs, initial=0.0)) > FACTOR or noise > NOISE_FACTOR


def _reaches(influence: np.ndarray) -> bool:
    return bool(np.any(influence > FACTOR)) and keeps_growing(influence)
