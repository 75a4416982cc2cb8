"""The errors of the modelling core: each lists every fault, not only the first."""

from __future__ import annotations

from collections.abc import Iterable

__all__ = ["EquationError", "ModelError", "SimulationError"]


class ModelError(ValueError):
    """A model cannot be assembled; ``faults`` lists everything that is wrong with it.

    Parameters
    ----------
    model : str
        Name of the model.
    faults : iterable of str
        One sentence each, naming the part and the remedy.
    """

    def __init__(self, model: str, faults: Iterable[str]):
        self.faults = tuple(faults)
        noun = "fault" if len(self.faults) == 1 else "faults"
        lines = "\n".join(f"  - {fault}" for fault in self.faults)
        super().__init__(f"model '{model}' has {len(self.faults)} {noun}:\n{lines}")


class EquationError(ValueError):
    """An equation is outside the subset of Python in which equations are written."""


class SimulationError(RuntimeError):
    """A simulation or a search for an equilibrium failed; the message names time and state."""
