"""Settings of the updating chain, with the paper's values as defaults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from gearbox.signals.signal import Processing
from gearbox.signals.similarity import LAG_RULES, LagRule
from gearbox.updating.errors import UpdatingError
from surrogate import DesignSpace

__all__ = ["OBJECTIVES", "ObjectiveKind", "UpdatingSettings"]

ObjectiveKind = Literal["similarity", "difference", "amplitudes"]
#: What each of them is the value of.
OBJECTIVES: dict[ObjectiveKind, str] = {
    "similarity": "cosine similarity",
    "difference": "share of the signal explained",
    "amplitudes": "share of the mesh lines explained",
}
Method = Literal["firefly", "differential_evolution", "direct", "multistart"]


@dataclass(frozen=True, kw_only=True)
class UpdatingSettings:
    """How a model is updated.

    Parameters
    ----------
    space : DesignSpace
        All parameters that may be looked at, with their ranges (Table 3).
    start : mapping of str to float
        Their values before updating (Table 2).
    sensor : str
        Compared by cosine similarity.
    sensors : tuple of str
        Compared by amplitudes and phases.
    driving_teeth : int
        z₁.
    objective : {"similarity", "difference", "amplitudes"}
        The paper's Eq. 8 or Eq. 7, the latter in the signals' own unit; or amplitudes and phases over several loads.
    processing : Processing
        Section 4.3.
    rule : str
        How the lag is chosen, see :data:`gearbox.signals.similarity.LAG_RULES`.
    orders : tuple of int
        Mesh orders compared by amplitudes and phases.
    free_gain : bool
        Whether each sensor has an unknown gain (amplitudes and phases only; cosine similarity never sees a gain).
    levels : int
        Points over each parameter's range for the sensitivity.
    share, most : float, int
        Parameters are kept whose range of the objective is at least this share of the largest, and at most so many.
    keep : tuple of str
        Parameters kept whatever the sensitivity says; empty to let it decide.
    points : tuple of int
        Sizes of the designs.
    test : int
        Points that no fit sees.
    surface_orders : tuple of int
        Orders of the response surface.
    method : str
        Of :func:`surrogate.maximise`.
    options : mapping
        Of the method: the paper's 30 fireflies and 100 iterations.
    seed : int
        Of all random numbers.
    identify : bool
        Whether to compute which directions of the parameters are identifiable.
    """

    space: DesignSpace
    start: Mapping[str, float]
    sensor: str
    driving_teeth: int
    sensors: tuple[str, ...] = ()
    objective: ObjectiveKind = "similarity"
    processing: Processing = field(default_factory=Processing)
    rule: LagRule = "best"
    orders: tuple[int, ...] = (1, 2, 3)
    free_gain: bool = False
    levels: int = 9
    share: float = 0.1
    most: int = 3
    keep: tuple[str, ...] = ()
    points: tuple[int, ...] = (25, 30, 35, 40, 45, 50)
    test: int = 20
    surface_orders: tuple[int, ...] = (2, 3)
    method: Method = "firefly"
    options: Mapping[str, Any] = field(default_factory=lambda: {"population": 30, "iterations": 100})
    seed: int = 0
    identify: bool = True

    def __post_init__(self) -> None:
        faults = self.faults()
        if faults:
            raise UpdatingError(faults)

    def faults(self) -> list[str]:
        """What is wrong with the settings, one sentence each."""
        from surrogate import METHODS

        faults = []
        names = self.space.names
        for name in names:
            if name not in self.start:
                faults.append(f"parameter '{name}' has no start value")
                continue
            low, high = (bounds[names.index(name)] for bounds in (self.space.lower, self.space.upper))
            if not low <= self.start[name] <= high:
                faults.append(f"start value {self.start[name]:g} of '{name}' lies outside {low:g} to {high:g}")
        faults += [
            f"there is no parameter '{n}' to keep; there are {', '.join(names)}" for n in self.keep if n not in names
        ]
        if self.rule not in LAG_RULES:
            faults.append(f"there is no lag rule '{self.rule}': take one of {', '.join(LAG_RULES)}")
        if self.objective not in OBJECTIVES:
            faults.append(f"there is no objective '{self.objective}': take one of {', '.join(OBJECTIVES)}")
        if self.method not in METHODS:
            faults.append(f"there is no method '{self.method}': take one of {', '.join(METHODS)}")
        if self.driving_teeth < 3:
            faults.append(f"{self.driving_teeth} driving teeth: give z₁ of the driving gear")
        if self.levels < 2:
            faults.append(f"levels = {self.levels}: the sensitivity needs at least 2 points over a range")
        if not 0.0 <= self.share <= 1.0 or self.most < 1:
            faults.append(f"share = {self.share:g} must lie between 0 and 1, and most = {self.most} be 1 or more")
        if not self.points or min(self.points) < 4:
            faults.append(f"points = {list(self.points)}: give sizes of designs of at least 4 points")
        if self.test < 2:
            faults.append(f"test = {self.test}: give at least 2 test points")
        if not self.surface_orders or not set(self.surface_orders) <= {1, 2, 3}:
            faults.append(f"orders = {list(self.surface_orders)} of the surface: take from 1, 2 and 3")
        if not self.orders or min(self.orders) < 1:
            faults.append(f"mesh orders {list(self.orders)}: give whole numbers of at least 1")
        if self.objective == "amplitudes" and not self.sensors:
            faults.append("the objective 'amplitudes' needs at least one sensor")
        return faults
