"""The default method: explicit until stability and not accuracy limits its steps, then stiff while that pays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.integrate import DenseOutput

from multibody.solvers.differences import forward_differences
from multibody.solvers.dormand_prince import DormandPrince54
from multibody.solvers.kernels.stepping import (
    DONE,
    KNOWN,
    MORE,
    SLOT,
    STEP,
    STEP_OLD,
    STIFF,
    SUSPECT,
    WANTED,
    WATCH,
    T,
)
from multibody.solvers.problem import NativeProblem
from multibody.solvers.rosenbrock import Rodas5P, relative_cost
from multibody.solvers.spectral_radius import spectral_radius

__all__ = ["LOOK", "Automatic", "in_words"]

LEAST_SPELL, LONGEST_SPELL = 64, 4096  # steps of the stiff method before the explicit one is tried again
RUN_UP, JUDGED = 8, 16  # steps of the stiff method until its own pace is reached, and until that pace is judged
# Explicit steps before a stiff method that did not pay is tried again, longer each time: a trial costs about eighty.
PATIENCE = 512
LOOK_AGAIN = 256  # explicit steps after which it is asked whether they have become so short that it would pay
LOOK = 2048  # explicit steps after which the Jacobian is evaluated
EDGE = 2.0  # |h·λ| from which steps count as stiff: on the edge of stability, at 3.3, they vary between 2 and 5
# Times that stiff steps must be longer than what they cost: for the same price the explicit ones, held short by
# stability, are far more exact (the lift with 17 states at rtol 3e-4: error 4e-5 in place of 4e-4).
GAIN = 1.5
SHORT_TRIAL = 64  # explicit steps after which, if they turn out stiff again, the next spell is longer


class Automatic(DormandPrince54):
    """Dormand and Prince's method that hands over to Rodas5P where the problem is stiff, and takes it back.

    The explicit method watches its last two stages, which show the fastest eigenvalue (Hairer and Wanner, Solving
    Ordinary Differential Equations II, IV.2).  After fifteen steps in a row on the edge of its stability the stiff
    method goes on from there.  Where the fast motion has died away to rounding the stages do not show it; the Jacobian,
    evaluated every two thousand explicit steps, does.  After a spell the explicit method is tried again, because a
    machine may be stiff only while it rests in dry friction.  If the stiff method's steps turn out not to be longer by
    more than they cost, the explicit one goes on, at first for some hundred steps, or until its own are so much shorter
    than the stiff ones were that these would pay.  A problem without a tangent stays with the explicit method.

    It takes what `NativeSolver` takes, and two more parameters.

    Parameters
    ----------
    stiff_problem : callable, optional
        Returns the same problem with what a Jacobian takes; called at the first stiff spell, so that a problem that
        never is stiff compiles no tangent for it.
    history : list, optional
        Gets a pair (time in s, name of the method) at every change.
    """

    def __init__(
        self,
        fun: Any,
        t0: float,
        y0: Any,
        t_bound: float,
        problem: NativeProblem | None = None,
        stiff_problem: Callable[[], NativeProblem] | None = None,
        history: list[tuple[float, str]] | None = None,
        **options: Any,
    ) -> None:
        super().__init__(fun, t0, y0, t_bound, problem=problem, **options)
        self._options = (fun, options)
        self._tangent_later = stiff_problem
        self._history = [] if history is None else history
        self._history.append((float(self.t), "explicit"))
        self._tally[WATCH] = int(self.problem.tangent is not None or stiff_problem is not None)
        self._stiff: Rodas5P | None = None
        self._in_stiff = self._stored_stiff = False
        self._spell = LEAST_SPELL
        self._done = 0  # steps since the last change
        self._judged = 0  # of them, when it was last asked whether the stiff method pays
        self._since = float(self.t)  # time of the last change
        self._explicit_step = 0.0
        self._cost = 0.0  # of a stiff step over an explicit one
        self._rates: Callable[[float, np.ndarray], np.ndarray] | None = None
        self._mark = float(self.t)  # time at the end of the stiff method's run-up
        self._patience = PATIENCE
        self._proven = False  # whether the last spell paid to its end: then the next is not judged early
        self._rest = 0  # explicit steps before stiffness is watched for again
        self._short = 0.0  # explicit step below which the stiff method would have paid when it was last judged
        self._unseen = 0  # explicit steps since the Jacobian was evaluated

    def _advance(self) -> int:
        self._stored_stiff = self._in_stiff
        if self._in_stiff:
            return self._advance_stiff()
        return self._after_explicit(self._limited(self._explicit_steps(), super()._advance))

    def _explicit_steps(self) -> int:
        """Return after how many explicit steps to look again."""
        return min(self._rest, LOOK_AGAIN) if self._rest > 0 else LOOK - self._unseen

    def _after_explicit(self, status: int) -> int:
        """Decide about the method after some explicit steps; return what became of them."""
        done = int(self._tally[DONE])
        if self._rest > 0:
            self._rest -= done
            if self._rest <= 0 or abs(float(self._clock[STEP_OLD])) < self._short:
                self._rest, self._tally[WATCH] = 0, 1
            return status
        self._unseen += done
        if status == STIFF or (status == MORE and self._overlooked()):
            self._enter()
            return MORE
        return status

    def go_on(self, status: int, clock: np.ndarray, tally: np.ndarray, y: np.ndarray, last: np.ndarray) -> int:
        """Go on after explicit steps that were taken elsewhere, until there are explicit steps to be taken again.

        Parameters
        ----------
        status : int
            How the run stands after them.
        clock, tally, y, last : ndarray
            The run, and the rates at its state; what comes of it is written there, with the explicit steps wanted.

        Returns
        -------
        status : int
            How it stands now.
        """
        mine = self._clock, self._tally, self._state, self._store[2][0, self.STAGES - 1]
        wanted = int(self._tally[WANTED])
        for own, given in zip(mine, (clock, tally, y, last), strict=True):
            own[:] = given
        self._tally[WANTED] = wanted
        self._done += int(self._tally[DONE])
        status = self._after_explicit(status)
        while self._in_stiff and status == MORE:
            status = self._advance()
            self.problem.check()
        for own, given in zip(mine, (clock, tally, y, last), strict=True):
            given[:] = own
        tally[WANTED] = min(wanted, self._explicit_steps())
        return status

    def _overlooked(self) -> bool:
        """Tell, after many explicit steps, whether it is stability that limits them."""
        if self._unseen < LOOK or not self._tally[WATCH]:
            self._unseen %= LOOK
            return False
        self._unseen = 0
        jacobian = self._differences()
        finite = bool(np.all(np.isfinite(jacobian)))
        return finite and abs(float(self._clock[STEP_OLD])) * spectral_radius(jacobian[None])[0] > EDGE

    def _differences(self) -> np.ndarray:
        """Return the Jacobian of the rates by forward differences: good enough for its largest eigenvalue."""
        n, t = self.problem.n, float(self._clock[T])
        x = self._state[:n].copy()
        sizes = np.maximum(np.abs(x), self.atol[:n] / self.rtol[:n])
        if self._rates is None:
            self._rates = (replace(self.problem, directions=None) if self.problem.n_directions else self.problem).fun
        rates = self._rates
        return forward_differences(lambda moved: rates(t, moved), x, sizes)

    def _limited(self, steps: int, advance: Callable[[], int]) -> int:
        """Advance by at most so many steps; return what became of it."""
        tally = self._tally
        wanted = int(tally[WANTED])
        tally[WANTED] = min(steps, wanted)
        status = advance()
        tally[WANTED] = wanted
        self._done += int(tally[DONE])
        return status

    def _enter(self) -> None:
        """Prepare the stiff method to go on from here."""
        if self._stiff is None:
            self._stiff = self._partner()
            self._cost = relative_cost(self._stiff.problem)
        elif self._done <= SHORT_TRIAL:
            self._spell = min(2 * self._spell, LONGEST_SPELL)
        else:
            self._spell = LEAST_SPELL
        self._explicit_step = abs(float(self._clock[STEP_OLD]))
        judged = not self._proven and self.problem.n_directions
        if judged and not self._pays(pace := self._pace_alone()):
            self._rest_awhile(pace)
            self._tally[SUSPECT] = 0
            return
        self._change(True)

    def _pace_alone(self) -> float:
        """Return the steps that the stiff method takes from here without the directions, in s.

        With them it is rarely faster, and a trial costs as much as hundreds of explicit steps: this tells beforehand.
        """
        fun, options = self._options
        own = {k: options[k] for k in ("max_step",) if k in options}
        n, t = self.problem.n, float(self._clock[T])
        first = min(self._explicit_step, abs(self.t_bound - t))  # at the end there is less left than a step
        partner = Rodas5P(
            fun, t, self._state[:n].copy(), self.t_bound, problem=replace(self._with_tangent(), directions=None),
            rtol=self.rtol[:n], atol=self.atol[:n], first_step=first, internal_steps=1, **own,
        )  # fmt: skip
        mark = t
        for step in range(JUDGED):
            partner._tally[WANTED] = 1
            if partner._advance() != MORE:
                break
            if step + 1 == RUN_UP:
                mark = float(partner._clock[T])
        else:
            return (float(partner._clock[T]) - mark) / (JUDGED - RUN_UP)
        return np.inf  # it fails, or comes to the end: the trial itself tells

    def _change(self, stiff: bool) -> None:
        self._in_stiff = stiff
        self._done, self._judged, self._since = 0, 0, float(self._clock[T])
        # What one method stored of its last step means nothing to the other.
        self._tally[KNOWN], self._tally[SUSPECT], self._tally[SLOT] = 0, 0, 0
        self._history.append((self._since, "stiff" if stiff else "explicit"))

    def _partner(self) -> Rodas5P:
        """Return the stiff method on the same clock, state and samples."""
        partner = Rodas5P.sharing_with(self, self._with_tangent())
        partner._largest = self._work[2 * self.problem.size :]
        return partner

    def _with_tangent(self) -> NativeProblem:
        ready = self.problem.columns is not None or self._tangent_later is None
        if self.problem.tangent is not None and ready:
            return self.problem
        assert self._tangent_later is not None
        return self._tangent_later()

    def _advance_stiff(self) -> int:
        assert self._stiff is not None
        goal = next(n for n in (RUN_UP, JUDGED, self._spell) if self._judged < n and (n > JUDGED or not self._proven))
        status = self._limited(goal - self._done, self._stiff._advance)
        if status != MORE or self._done < goal:  # with a full buffer the samples of the last step come first
            return status
        self._judged = goal
        if goal == RUN_UP:
            self._mark = float(self._clock[T])
            if not self._pays(2.0 * float(self._clock[STEP])):  # far from it: the rest of the trial would tell the same
                self._leave(float(self._clock[STEP]))
        elif goal == self._spell:
            self._leave((float(self._clock[T]) - self._since) / self._done)
        elif not self._pays(pace := (float(self._clock[T]) - self._mark) / (JUDGED - RUN_UP)):
            self._leave(pace)
        return status

    def _pays(self, step: float) -> bool:
        """Tell whether stiff steps of a size are longer than explicit ones by clearly more than they cost."""
        return abs(step) >= GAIN * self._explicit_step * self._cost

    def _leave(self, step: float) -> None:
        """Go back to the explicit method, and stay there for a while if the stiff steps did not pay."""
        clock = self._clock
        self._proven = self._pays(step)
        if self._proven:
            self._patience = PATIENCE
        else:
            self._rest_awhile(step)
        clock[STEP] = min(clock[STEP], self._explicit_step)
        self._change(False)

    def _rest_awhile(self, step: float) -> None:
        """Watch for stiffness again after many explicit steps, longer each time, or where these become short.

        How long they must be for the stiff steps of this size not to pay does not depend on where the machine is.
        """
        self._tally[WATCH] = 0
        self._short = abs(step) / (GAIN * self._cost)
        self._rest, self._patience = self._patience, 2 * self._patience

    def _dense_output_impl(self) -> DenseOutput:
        if self._stored_stiff and self._stiff is not None:
            self._stiff.t_old, self._stiff.t = self.t_old, self.t
            return self._stiff._dense_output_impl()
        return super()._dense_output_impl()


def in_words(history: list[tuple[float, str]], end: float) -> str:
    """Say what `Automatic` did from its history.

    Examples
    --------
    >>> in_words([(0.0, "explicit")], 2.0)
    'explicit throughout: nothing stiff was met'
    >>> in_words([(0.0, "explicit"), (0.5, "stiff"), (1.5, "explicit")], 2.0)
    'stiff for 50 % of the time, in one spell from 0.5 s; else explicit'
    """
    spells = sum(name == "stiff" for _, name in history)
    if not spells:
        return "explicit throughout: nothing stiff was met"
    times = np.array([t for t, _ in history] + [end])
    stiff = sum(after - t for (t, name), after in zip(history, times[1:], strict=True) if name == "stiff")
    share = 100.0 * stiff / max(end - times[0], 1e-300)
    first = next(t for t, name in history if name == "stiff")
    many = "one spell" if spells == 1 else f"{spells} spells"
    return f"stiff for {share:.0f} % of the time, in {many} from {first:.3g} s; else explicit"
