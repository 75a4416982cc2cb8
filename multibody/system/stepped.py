"""Models with a part that steps itself from sample to sample: a run of one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from multibody.inputs.table import InputTable
    from multibody.system.compiled import CompiledSystem

__all__ = ["LongStepsWarning", "SteppedRun", "run_stepped"]


class LongStepsWarning(RuntimeWarning):
    """The shortest steps that are tried still change what a part shows."""


@dataclass(frozen=True, eq=False)
class SteppedRun:
    """A run at the times that were asked for.

    Parameters
    ----------
    states : ndarray, shape (nt, n)
    inputs : ndarray, shape (nt, n_u)
        Those of the system, with what the part shows among them.
    evaluations : int
        Steps of the part, and evaluations of the equations around it.
    divisions : int
        Steps of the part between two times.
    """

    states: np.ndarray
    inputs: np.ndarray
    evaluations: int
    divisions: int


def run_stepped(
    system: CompiledSystem, p: np.ndarray, x0: np.ndarray, table: InputTable, times: np.ndarray, **options: Any
) -> SteppedRun:
    """Simulate a model with a part that steps itself; options as of `multibody.fmi.communication.stepped_run`.

    Raises
    ------
    SimulationError
        If it cannot be simulated.
    """
    owner = system.model.stepped_part
    assert owner is not None
    run: SteppedRun = system.model.components[owner].stepped_run(system, owner, p, x0, table, times, **options)  # type: ignore[attr-defined]
    return run
