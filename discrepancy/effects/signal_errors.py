"""Errors of signals that enter a machine: of recorded inputs, and of what a controller gives."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from estimation.response.sensors import lagged
from multibody.declare.component import Component
from multibody.declare.declarations import Input, Output, Parameter, State, Unit

if TYPE_CHECKING:
    from multibody.machine.model import Model

__all__ = ["SignalLag", "inserted", "signal_error"]

CONSTANT = 1e-12  # relative variation up to which a signal counts as constant


class SignalLag(Component):
    """A signal that comes late: output = input − lag/filter · (input − z), filter · rate of z = input − z.

    With lag = filter it is a low-pass of first order, with lag = 2·filter the Padé approximation [1/1] of a delay; with
    lag = 0 it is absent.  Give ``z`` the start value of the input where that is not zero.
    """

    unit = Unit("1", "unit of the signal")
    lag = Parameter(0.0, "s", "by how much slow changes come late")
    filter = Parameter(1e-3, "s", "time constant of the filter behind it", min=1e-12)
    input = Input("{unit}", "signal that comes in")
    z = State("{unit}", "signal behind the filter")
    output = Output("{unit}", "signal that goes out")

    def equations(self):
        behind = self.input - self.z
        self.der.z = behind / self.filter
        self.output = self.input - self.lag / self.filter * behind


def signal_error(law: str, time: np.ndarray, u: np.ndarray, filter_time: float = 0.0) -> np.ndarray:
    """Return how a signal changes for a unit of one of its errors.

    Parameters
    ----------
    law : {"offset", "gain", "delay", "lag"}
    time : ndarray, shape (nt,), s
    u : ndarray, shape (nt,)
        The signal.
    filter_time : float, s
        Time constant of the filter of a lag.
    """
    if law == "offset":
        return np.ones_like(time)
    if law == "gain":
        return u
    if np.ptp(u) <= CONSTANT * np.max(np.abs(u)):  # its rate is only rounding
        return np.zeros_like(time)
    return -np.gradient(u, time) if law == "delay" else -(u - lagged(time, u, filter_time)) / filter_time


def inserted(model: Model, name: str, signal: str, part: Component) -> Model:
    """Return a copy of a model with a part between a signal and the inputs that it feeds.

    Parameters
    ----------
    model : Model
    name : str
        Of the part.
    signal : str
        A model input, or an output of `multibody.model.driving_signals`.
    part : Component
        With ``input`` and ``output``.
    """
    from multibody.model.driving_signals import driving_signals

    other = model.copy()
    if signal in other.inputs:
        entry = other.inputs[signal]  # of the copy; its gain, offset and delay stay
        targets, entry.targets = entry.targets, [f"{name}.input"]
        other.add(name, part)
    else:
        targets = driving_signals(model)[signal]
        other.add(name, part)
        other.disconnect(signal)  # every connection of it; what it feeds beside is connected again
        for ends in model.connections:
            rest = [end for end in ends if end not in targets]
            if signal in ends and len(rest) > 1:
                other.connect(*rest)
        other.connect(signal, f"{name}.input")
    other.connect(f"{name}.output", *targets)
    return other
