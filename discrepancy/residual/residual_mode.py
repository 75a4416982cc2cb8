"""The mode in which a residual is taken: whole records simulated, windows simulated, or the recorded motion given.

See docs/method/residuals.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.problem.problem import Problem
from discrepancy.problem.study_file import StudyError
from discrepancy.residual.free_rotations import free_rotations
from discrepancy.residual.initial_state import DIVERGED_ERROR, StateEstimate, estimate_states
from discrepancy.residual.input_noise import reduce_input_noise
from discrepancy.residual.inverse import inverse_problem
from discrepancy.residual.prepared_problem import PreparedProblem
from discrepancy.residual.windows import (
    DIVERGENCE_FACTOR,
    LEAST_SAMPLES,
    MOST_UNKNOWNS,
    NOISE_FACTOR,
    WINDOW_FACTOR,
    ErrorGrowth,
    crop,
    cut_windows,
    divergence_time,
    error_growth,
    keeps_growing,
    samples_needed,
)
from multibody.base.parallel import parallel_map
from multibody.base.progress import silent

if TYPE_CHECKING:
    from estimation.response.experiment import Experiment

__all__ = ["prepared_problem", "problem_in_windows"]


def prepared_problem(problem: Problem, progress: Callable[[str], None] = silent) -> PreparedProblem:
    """Choose the mode of the residual, and prepare the experiments for it.

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
    prepared = _in_chosen_mode(problem, progress)
    # Windows weight the noise of inputs, a given motion has its own low-pass, and a unit that is stepped would be run
    # once for each sample of each input.
    if prepared.mode != "simulation" or problem.inputs == "as recorded" or problem.model.stepped_part:
        return prepared
    quiet, noisy = reduce_input_noise(prepared.problem, progress)
    return replace(prepared, problem=quiet, noisy=noisy)


def _in_chosen_mode(problem: Problem, progress: Callable[[str], None]) -> PreparedProblem:
    """Return the problem in the mode that the study asks for, or that suits the machine."""
    if problem.model.stepped_part:
        return PreparedProblem(problem, "simulation", "a unit that is stepped shows no states to predict from")
    if any(e.at_own_instants for e in problem.identify):
        if problem.residual in ("prediction", "inverse"):
            raise StudyError(
                [
                    f'[study] residual = "{problem.residual}": outputs have instants or clocks of their own, which '
                    'only simulations of whole records are compared at: use "simulation", or bring the channels onto '
                    "one grid with resample in [records]"
                ]
            )
        return PreparedProblem(problem, "simulation", "outputs are compared at instants or clocks of their own")
    if problem.residual == "simulation":
        return PreparedProblem(problem, "simulation", "asked for by the study")
    if problem.residual == "inverse":
        progress("prescribe the recorded motion")
        inverse = inverse_problem(problem)
        return replace(inverse, reason=f"asked for by the study; {inverse.reason}")
    progress("how fast a simulation with a small error of the initial state diverges")
    if problem.residual == "auto":  # two records show a machine that does not diverge, as most do not
        growth = _RecordStates.of(problem, two_records=True).largest_growth()
        if not np.isfinite(growth.within) and not _sensitive_to_inputs(growth):
            return PreparedProblem(problem, "simulation", _does_not_diverge(growth))
    along = _RecordStates.of(problem)
    growth = along.largest_growth()
    if problem.residual == "auto" and not np.isfinite(growth.within):
        return PreparedProblem(problem, "simulation", _does_not_diverge(growth))
    length, least = along.window_length(), along.least_length()
    if length < least and problem.residual == "auto":
        alternative = _inverse_for_short_windows(problem, length)
        if alternative is not None:
            return alternative
    progress(f"cut the records into windows of at most {max(length, least):.3g} s")
    windowed, count = along.in_windows(length)
    reason = f"{_diverges(growth)}; the records are cut into {count} windows, most of about {max(length, least):.2g} s"
    if length < least:
        reason += (
            f", the shortest that leave {LEAST_SAMPLES} samples (errors grow within {length:.2g} s: record faster)"
        )
    if problem.residual == "prediction":
        reason = f"asked for by the study; {reason}"
    return PreparedProblem(windowed, "prediction", reason)


def problem_in_windows(
    problem: Problem, errors: Mapping[str, float] | None = None, progress: Callable[[str], None] = silent
) -> PreparedProblem | None:
    """Return the problem cut into windows, where calibrated simulations of whole records have diverged from them.

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
        None where the simulations follow the records, and where windows would be as long as the records: the simulation
        does not diverge, the model is wrong.
    """
    if any(e.at_own_instants for e in problem.identify):
        return None
    if errors is not None and _surely_follow(problem, errors):
        return None
    along = _RecordStates.of(problem)
    reason = "as before"
    if errors is not None:
        shares = {n: errors[n] / s for n, s in zip(along.experiments[0].outputs, along.spread, strict=True)}
        worst = max(shares, key=lambda n: shares[n])
        if not shares[worst] > DIVERGED_ERROR:
            return None
        reason = f"simulations of whole records differ from {worst} by {shares[worst]:.0%} of its spread"
    length, least = along.window_length(), along.least_length()
    if max(length, least) > 0.5 * max(e.record.duration for e in along.experiments):
        return None
    progress(f"cut the records into windows of at most {max(length, least):.3g} s: {reason}")
    windowed, count = along.in_windows(length)
    return PreparedProblem(
        windowed,
        "prediction",
        f"{reason}, and show nothing that is missing: the records are cut into {count} windows, most of about "
        f"{max(length, least):.2g} s",
    )


def _spread_of(experiments: Sequence[Experiment]) -> np.ndarray:
    """Return the standard deviation of each output over all records, SI; never quite zero."""
    values = np.concatenate([e.record.values(*e.outputs) for e in experiments])
    return np.maximum(np.std(values, axis=0), 1e-9 * np.maximum(np.max(np.abs(values), axis=0), 1e-300))


def _surely_follow(problem: Problem, errors: Mapping[str, float]) -> bool:
    """Tell whether the errors are small against every spread that an output may have: then no simulation is needed."""
    experiments = tuple(crop(e) for e in problem.identify)
    for name, spread in zip(experiments[0].outputs, _spread_of(experiments), strict=True):
        angle = experiments[0].record.signals[name].unit in ("rad", "")  # of one that counts no turns 1 rad at most
        if errors[name] > DIVERGED_ERROR * (min(spread, 1.0) if angle else spread):
            return False
    return True


@dataclass(frozen=True, eq=False)
class _RecordStates:
    """The records of a problem with the states estimated along them, from which the growth of errors follows."""

    problem: Problem
    estimates: tuple[StateEstimate, ...]
    spread: np.ndarray
    scale: np.ndarray

    @classmethod
    def of(cls, problem: Problem, *, two_records: bool = False) -> _RecordStates:
        """Estimate the states along all records, or along the longest and that with the widest outputs."""
        experiments = tuple(crop(e) for e in problem.identify)
        system = problem.model.build(outputs=experiments[0].outputs)
        p = system.parameter_vector({q.name: q.value for q in problem.uncertain})
        spread = _spread_of(experiments)
        units = np.array([system.unit(n) for n in experiments[0].outputs])
        if two_records:
            wide = [float(np.max(np.ptp(e.record.values(*e.outputs), axis=0) / spread)) for e in experiments]
            longest = int(np.argmax([e.record.duration for e in experiments]))
            experiments = tuple(experiments[i] for i in dict.fromkeys((longest, int(np.argmax(wide)))))
        estimates = tuple(parallel_map(lambda e: estimate_states(e, system, p), experiments))
        scale = np.std(np.concatenate([e.states for e in estimates]), axis=0)
        # A larger range of an angle does not make its errors matter less, unless the angle only counts turns.
        free_states, free_outputs = free_rotations(estimates)
        spread = np.where((units == "rad") & ~free_outputs, np.minimum(spread, 1.0), spread)
        angles = np.array([q.unit == "rad" for q in system.states], dtype=bool)
        scale = np.where(angles & ~free_states, np.minimum(scale, 1.0), scale)
        return cls(problem, estimates, spread, scale)

    @property
    def experiments(self) -> list[Experiment]:
        """The experiments of the records, cropped to what is used."""
        return [states.experiment for states in self.estimates]

    def largest_growth(self) -> ErrorGrowth:
        """Return how errors grow over the record in which they grow the soonest, or the furthest."""
        growths = parallel_map(self._growth, self.estimates)
        return min(growths, key=lambda g: (g.within, -float(np.max(g.start))))

    def _growth(self, states: StateEstimate) -> ErrorGrowth:
        growth = error_growth(states, self.spread, self.scale)
        cut = growth.time[-1] < 0.99 * states.experiment.record.duration
        if cut:  # the simulation broke off: the error at its end is unbounded
            start = growth.start.copy()
            start[-1] = np.inf
            growth = replace(growth, start=start)
        return growth

    def window_length(self) -> float:
        """Return the longest window over which errors stay small, s."""
        return divergence_time(self.estimates, self.spread, self.scale)

    def least_length(self) -> float:
        """Return the shortest window that leaves enough samples in every record, s."""
        return max(samples_needed(e.preparation, e.record.rate) / e.record.rate for e in self.experiments)

    def in_windows(self, length: float) -> tuple[Problem, int]:
        """Return the problem with every record cut into windows, and the number of those for identification."""
        system, p = self.estimates[0].system, self.estimates[0].p
        held_out = [estimate_states(crop(e), system, p) for e in self.problem.validate]
        identify, every = self._cut(self.estimates, length)
        validate, every_held_out = self._cut(held_out, length)
        warnings = self.problem.warnings
        if max(every, every_held_out) > 1:
            warnings = (
                *warnings,
                f"so many windows are needed that only some stand for the records, evenly spread: one of {every} in "
                f"those to fit, one of {every_held_out} in those held out",
            )
        return replace(self.problem, identify=identify, validate=validate, warnings=warnings), len(identify)

    def _cut(self, estimates: Sequence[StateEstimate], length: float) -> tuple[tuple[Experiment, ...], int]:
        """Return windows of some records with at most about `MOST_UNKNOWNS` states, and that one of how many is kept.

        Which are kept depends on lengths alone, never on how well they are followed, as in sections of long records.
        """
        count = sum(s.experiment.record.duration for s in estimates) / max(length, self.least_length())
        free = sum(not n.startswith("energy.") for n in self.estimates[0].system.state_names)
        every = max(1, math.ceil(count * free / MOST_UNKNOWNS))
        return tuple(w for s in estimates for w in cut_windows(s, length, self.spread, self.scale, every)), every


def _inverse_for_short_windows(problem: Problem, length: float) -> PreparedProblem | None:
    try:
        inverse = inverse_problem(problem)
    except StudyError:
        return None
    reason = (
        f"errors grow by a factor of {WINDOW_FACTOR:.0f} within {length:.2g} s, too short a time for windows of "
        f"{LEAST_SAMPLES} samples; {inverse.reason}"
    )
    return replace(inverse, reason=reason)


def _does_not_diverge(growth: ErrorGrowth) -> str:
    most = float(np.max(growth.start))
    if most < 1.5:
        effect = "an error of the initial state does not grow"
    elif most > DIVERGENCE_FACTOR:
        effect = (
            f"a 1 % error of the initial state changes an output by {most:.2g} % of its spread for a while, and has "
            "died out by the middle of the record"
        )
    else:
        effect = f"a 1 % error of the initial state changes no output by more than {most:.2g} % of its spread"
    return f"over {growth.time[-1]:.3g} s {effect}: simulations do not diverge, so whole records are simulated"


def _diverges(growth: ErrorGrowth) -> str:
    """Say which error grows, how far, and within which time."""
    if not np.isfinite(growth.within):
        return f"whole records could be simulated (errors grow by less than a factor of {DIVERGENCE_FACTOR:.0f})"
    if np.any(growth.start > DIVERGENCE_FACTOR) and not growth.is_forgotten:
        levels = (10.0 * DIVERGENCE_FACTOR, DIVERGENCE_FACTOR)
        most = next((f for f in levels if np.any(growth.start > f)), DIVERGENCE_FACTOR)
        when = float(growth.time[np.argmax(growth.start > most)])
        return (
            f"an error of the initial state grows by a factor of {most:.0f} within {when:.2g} s, so no simulation "
            "follows a whole record"
        )
    if np.any(growth.inputs > DIVERGENCE_FACTOR) and keeps_growing(growth.inputs):
        return (
            f"a 1 % error of {growth.input_name} changes {growth.output_name} by {growth.input_change:.2g} (SI) "
            f"within {growth.time[-1]:.2g} s, and its effect keeps growing, so no simulation follows a whole record"
        )
    name, output, size = growth.noisy
    return (
        f"the noise of {name} alone changes {output} by {size:.2g} (SI) within {growth.time[-1]:.2g} s, "
        f"{growth.noise[-1]:.0f} times that output's own noise, so no simulation follows a whole record"
    )


def _sensitive_to_inputs(growth: ErrorGrowth) -> bool:
    """Tell whether a small error of an input, or its noise, moves outputs far, though it settles in these records.

    A cabin that stands on its guides at the end of one trip no longer follows its rope; in the next trip it moves on.
    """
    noise = float(np.max(growth.noise, initial=0.0))
    return float(np.max(growth.inputs, initial=0.0)) > DIVERGENCE_FACTOR or noise > NOISE_FACTOR
