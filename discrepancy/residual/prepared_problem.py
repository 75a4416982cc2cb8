"""A study's problem in the form that its residual is taken from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from discrepancy.problem.problem import Problem

if TYPE_CHECKING:
    from discrepancy.residual.input_noise import NoisyInput

__all__ = ["PreparedProblem"]


@dataclass(frozen=True, eq=False)
class PreparedProblem:
    """A study's problem in the form that its residual is taken from.

    Parameters
    ----------
    problem : Problem
        With the experiments (and, in inverse mode, the model) that the residual is taken from.
    mode : {"simulation", "prediction", "inverse"}
        Whole records simulated, windows of them simulated, or the force that the recorded motion needs.
    reason : str
        Why this mode, in one sentence.
    noisy : tuple of NoisyInput
        Recorded inputs that simulations use low-passed, because their noise matters.
    """

    problem: Problem
    mode: str
    reason: str
    noisy: tuple[NoisyInput, ...] = ()
