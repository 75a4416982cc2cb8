"""The errors of the modelling core: each lists every fault, not only the first."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum

__all__ = ["EquationError", "ModelError", "SimulationError", "Stop", "StopMessage"]


class Stop(Enum):
    """Why an integration stopped before its end."""

    NOT_FINITE = "a value is not finite"
    STEP_TOO_SMALL = "the step became too small"
    TOO_MANY_EVALUATIONS = "the limit on evaluations was reached"
    OTHER = "another reason, which the message gives"


class StopMessage(str):
    """A message of a solver with its reason; SciPy hands it through as the text that it is."""

    stop: Stop

    def __new__(cls, text: str, stop: Stop) -> StopMessage:
        """Return the text with its reason."""
        message = super().__new__(cls, text)
        message.stop = stop
        return message


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
    """A simulation or a search for an equilibrium failed; the message names time and state.

    Parameters
    ----------
    message : str
    stop : Stop
        Why an integration stopped, for programs.
    evaluations : int
        Evaluations of the equations that the integration took until then.
    """

    def __init__(self, message: str, stop: Stop = Stop.OTHER, evaluations: int = 0) -> None:
        self.stop, self.evaluations = stop, evaluations
        super().__init__(message)

    def __reduce__(self) -> tuple[type[SimulationError], tuple[str, Stop, int]]:
        return type(self), (str(self), self.stop, self.evaluations)
