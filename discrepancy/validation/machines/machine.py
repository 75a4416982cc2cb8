"""What a machine of plain equations is: parameters, signals, equations, and the effects that can be hidden in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Channel", "Drive", "Effect", "Machine", "Parameter", "Start", "actuator", "sensor"]

Array = NDArray[np.float64]
Signals = dict[str, Array]
Values = SimpleNamespace


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A parameter that the owner of the machine knows within a deviation.

    Parameters
    ----------
    name : str
        Name in the equations.
    stated : float
        The value that the owner states, SI.
    std : float
        Its standard deviation, SI.
    path : str
        Parameter of the baseline model.
    positive : bool
        The baseline model refuses values below zero.
    """

    name: str
    stated: float
    std: float
    path: str
    positive: bool = True


@dataclass(frozen=True)
class Start:
    """A start value that differs from record to record, and that the study fits for each of them.

    Parameters
    ----------
    name : str
        Name in the equations; zero stands for the baseline model's own start value.
    std : float
        Deviation from record to record, SI.
    state : str
        State of the baseline model.
    """

    name: str
    std: float
    state: str


@dataclass(frozen=True, kw_only=True)
class Channel:
    """A measured output.

    Parameters
    ----------
    name : str
        Name in the equations.
    column : str
        Column of the recordings, with its unit.
    scale : float
        Number in the file by SI value.
    output : str
        Output of the baseline model.
    noise : float
        Standard deviation of the white noise, SI.
    quantum : float
        Step of the converter, SI; zero: none.
    unit : str
        Unit for the study, where the column's name does not state it.
    """

    name: str
    column: str
    output: str
    noise: float
    scale: float = 1.0
    quantum: float = 0.0
    unit: str = ""

    @property
    def deviation(self) -> float:
        """Standard deviation of noise and quantisation together, SI."""
        return float(np.hypot(self.noise, self.quantum / np.sqrt(12.0)))


@dataclass(frozen=True, kw_only=True)
class Drive:
    """A recorded input; ``hold`` says that it stays between the rows, else it is linear."""

    name: str
    column: str
    input: str
    scale: float = 1.0
    hold: bool = False
    unit: str = ""


@dataclass(frozen=True, kw_only=True)
class Effect:
    """Something that the baseline model lacks.

    Parameters
    ----------
    name : str
        Name within the machine.
    strength : str
        The quantity of the equations that is zero where the effect is absent.
    size : float
        A usual strength, SI: where the search for the graded strength begins.
    accept : tuple of str
        Shell patterns over ``kind@where`` that name it rightly.  Empty: the catalogue does not hold it.
    shape : mapping of str to (float, float)
        Further quantities of the equations, drawn between two values.
    signed : bool
        Both signs of the strength make sense.
    what : str
        The law in words.
    """

    name: str
    strength: str
    size: float
    accept: tuple[str, ...] = ()
    shape: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    signed: bool = False
    what: str = ""

    @property
    def outside(self) -> bool:
        """True if no kind of the catalogue describes it."""
        return not self.accept


def sensor(channel: str, output: str, error: str, size: float) -> Effect:
    """Return the effect of a sensor's error: ``offset``, ``gain``, ``delay`` or ``drift``."""
    name = f"{channel}_{error}"
    accept = (f"sensor_{error}@{output}",)
    return Effect(name=name, strength=name, size=size, accept=accept, signed=error != "delay", what=f"sensor {error}")


def actuator(drive: str, model_input: str, error: str, size: float, also: Sequence[str] = ()) -> Effect:
    """Return the effect of an input's error: ``offset``, ``gain``, ``delay``; ``also`` are names that mean the same."""
    name = f"{drive}_{error}"
    accept = (f"input_{error}@{model_input}", *also)
    return Effect(name=name, strength=name, size=size, accept=accept, signed=error != "delay", what=f"input {error}")


@dataclass(frozen=True, kw_only=True)
class Machine:
    """A machine as equations over many runs at once: every quantity is an array with one entry for each run.

    Parameters
    ----------
    name, about : str
        Short name; what the owner knows, Markdown.
    model : str
        Text of the baseline model's file; its function is ``build``.
    parameters, starts, channels, drives, effects : sequences
        See their classes.
    places : mapping of str to float
        Where an unrecorded disturbance can act, and its usual root mean square, SI.
    dt : float
        Time from row to row, s.
    rows : int
        Rows of a record.
    substeps : int
        Integration steps from row to row.
    excite : callable
        From a generator and the times, the drives of one record, each an array over the rows.
    start : callable
        From the values, the states at the first row, one array each.
    step : callable
        From states, drives (a function of the part of the step that has passed), disturbances, values and the length of
        a step, the states after it.
    observe : callable
        From states, drives and values, the true value of each channel.
    control : callable, optional
        A sampled controller: from its memory (None at first), the measured channels, the drives and the values, its
        memory and what it gives, held until the next row.
    constants : mapping of str to float
        Quantities of the equations that the owner knows exactly.
    identify, validate : int
        Number of records.
    """

    name: str
    about: str
    model: str
    parameters: tuple[Parameter, ...]
    channels: tuple[Channel, ...]
    drives: tuple[Drive, ...]
    effects: tuple[Effect, ...]
    places: Mapping[str, float]
    dt: float
    rows: int
    excite: Callable[[np.random.Generator, Array], Signals]
    start: Callable[[Values], Sequence[Array]]
    step: Callable[[Array, Callable[[float], Signals], Signals, Values, float], Array]
    observe: Callable[[Array, Signals, Values], Signals]
    starts: tuple[Start, ...] = ()
    control: Callable[[Any, Signals, Signals, Values], tuple[Any, Signals]] | None = None
    constants: Mapping[str, float] = field(default_factory=dict)
    substeps: int = 4
    identify: int = 4
    validate: int = 2

    @property
    def times(self) -> Array:
        """Times of the rows, s."""
        return self.dt * np.arange(self.rows, dtype=np.float64)

    def effect(self, name: str) -> Effect:
        """Return an effect by its name.

        Raises
        ------
        KeyError
            With the names that exist.
        """
        for effect in self.effects:
            if effect.name == name:
                return effect
        known = ", ".join(e.name for e in self.effects)
        raise KeyError(f"the machine '{self.name}' has no effect '{name}': take one of {known}")
