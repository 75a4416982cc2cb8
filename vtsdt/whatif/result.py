"""Results of a what-if study: energies of each action, savings of each section, with intervals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from vtsdt.files.rail_profile_table import ProfileTable
from vtsdt.lift.energy import TripEnergy

if TYPE_CHECKING:
    import pandas

__all__ = ["Action", "Interval", "SectionSaving", "WhatIf"]

FIGURES = ("E_c", "E_cw", "E_cb", "E_m", "eta_t")


@dataclass(frozen=True)
class Interval:
    """A value and the interval that contains 95 % of the draws; NaN without draws."""

    value: float
    low: float
    high: float

    @staticmethod
    def of(value: float, draws: Any) -> Interval:
        """Return the nominal value with the interval of the drawn ones."""
        drawn = np.asarray(draws, dtype=float)
        if drawn.size < 2:
            return Interval(float(value), float("nan"), float("nan"))
        return Interval(float(value), *(float(q) for q in np.quantile(drawn, (0.025, 0.975))))

    def text(self, factor: float = 1.0, digits: int = 2) -> str:
        """Return the value as text, with its interval where there is one."""

        def digits_of(value: float) -> str:
            return f"{round(factor * value, digits) + 0.0:.{digits}f}"  # no minus zero

        if not np.isfinite(self.low):
            return digits_of(self.value)
        return f"{digits_of(self.value)} ({digits_of(self.low)} to {digits_of(self.high)})"

    def to_json(self) -> dict[str, float | None]:
        """Return value and bounds; None where there is no interval."""
        return {k: (v if np.isfinite(v) else None) for k, v in vars(self).items()}


@dataclass(frozen=True, eq=False)
class Action:
    """Energies of one action: nominal, and of each draw."""

    name: str
    nominal: TripEnergy
    drawn: tuple[TripEnergy, ...] = ()

    def figure(self, name: str) -> Interval:
        """Return one of E_c, E_cw, E_cb, E_m (J) and eta_t with its interval."""
        return Interval.of(getattr(self.nominal, name), [getattr(e, name) for e in self.drawn])


@dataclass(frozen=True, eq=False, kw_only=True)
class SectionSaving:
    """A section of the rail above the threshold, and what straightening it alone would save.

    Parameters
    ----------
    low, high : float, m
    worst : float, m
        Height of the largest deviation.
    deviation, spread : float, m
        Largest deviation and its standard deviation.
    probability : float
        That the deviation there is above the threshold.
    saving : float, J
        Of one trip.
    drawn : tuple of float, J
    """

    low: float
    high: float
    worst: float
    deviation: float
    spread: float
    probability: float
    saving: float
    drawn: tuple[float, ...] = ()

    @property
    def interval(self) -> Interval:
        """The saving with its interval, J."""
        return Interval.of(self.saving, self.drawn)


@dataclass(frozen=True, eq=False, kw_only=True)
class WhatIf:
    """The effect of corrective actions.

    Parameters
    ----------
    actions : tuple of Action
        original, straightened, lubrication, both.
    sections : tuple of SectionSaving
    rail : ProfileTable
        The profile of the model's rail.
    threshold : float, m
    lubrication : float
    direction : str
    uncertainties : tuple of (name, size)
    drawn : tuple of dict
        Parameters of each draw.
    seed : int
    """

    actions: tuple[Action, ...]
    sections: tuple[SectionSaving, ...]
    rail: ProfileTable
    threshold: float
    lubrication: float
    direction: str
    uncertainties: tuple[tuple[str, str], ...]
    drawn: tuple[dict[str, float], ...]
    seed: int

    def __getitem__(self, name: str) -> Action:
        return next(a for a in self.actions if a.name == name)

    def saving(self, name: str) -> Interval:
        """Return what an action saves in both guides on one trip, J, draw by draw."""
        base, other = self["original"], self[name]

        def lost(e: TripEnergy) -> float:
            return e.E_c + e.E_cw

        pairs = zip(base.drawn, other.drawn, strict=True)
        return Interval.of(lost(base.nominal) - lost(other.nominal), [lost(a) - lost(b) for a, b in pairs])

    def gain(self, name: str) -> Interval:
        """Return the increase of eta_t by an action, as a share."""
        base, other = self["original"], self[name]
        pairs = zip(base.drawn, other.drawn, strict=True)
        return Interval.of(other.nominal.eta_t - base.nominal.eta_t, [b.eta_t - a.eta_t for a, b in pairs])

    def better(self, one: str, other: str) -> float:
        """Return the share of draws in which one action saves more than another; NaN without draws."""
        pairs = list(zip(self[one].drawn, self[other].drawn, strict=True))
        return float(np.mean([a.E_c + a.E_cw < b.E_c + b.E_cw for a, b in pairs])) if pairs else float("nan")

    def to_frame(self) -> pandas.DataFrame:
        """Return Table 4: figures as rows, actions as columns."""
        import pandas

        table = {a.name: [a.figure(f).value * (100 if f == "eta_t" else 1) for f in FIGURES] for a in self.actions}
        return pandas.DataFrame(table, index=["E_c [J]", "E_cw [J]", "E_cb [J]", "E_m [J]", "eta_t [%]"])

    def to_json(self) -> dict[str, Any]:
        """Return everything but the draws themselves."""
        return {
            "schema": 1,
            "direction": self.direction,
            "threshold_mm": 1e3 * self.threshold,
            "lubrication": self.lubrication,
            "seed": self.seed,
            "draws": len(self.drawn),
            "doubts": dict(self.uncertainties),
            "units": {"E": "J", "eta_t": "1"},
            "actions": {
                a.name: {
                    **{f: a.figure(f).to_json() for f in FIGURES},
                    "saving": self.saving(a.name).to_json(),
                    "gain": self.gain(a.name).to_json(),
                }
                for a in self.actions
            },
            "sections": [
                {
                    "low_m": s.low,
                    "high_m": s.high,
                    "worst_m": s.worst,
                    "deviation_mm": 1e3 * s.deviation,
                    "spread_mm": 1e3 * s.spread,
                    "probability_beyond": s.probability,
                    "saving_J": s.interval.to_json(),
                }
                for s in self.sections
            ],
            "profile": self.rail.to_json(),
        }
