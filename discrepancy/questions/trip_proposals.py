"""Trips that would distinguish two explanations: how likely each is to decide, and how it is described."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from discrepancy.questions.trip_plan import TripPlan
from discrepancy.statistics.thresholds import DECISIVE_BIC
from multibody.base.quantity_text import count_text

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["NextMeasurement", "Proposal", "chance", "repeats_needed"]

#: Probability of a decisive difference of BIC that is enough.
ENOUGH = 0.8


def chance(separation: float, decides: float = DECISIVE_BIC) -> float:
    """Return the chance that a trip with a separation D decides, by a difference of BIC as in the search.

    Examples
    --------
    >>> round(chance(0.0), 3), round(chance(6.0), 3), round(chance(20.0), 3)
    (0.0, 0.5, 0.941)
    """
    from math import erf, sqrt

    if not separation > 0.0:
        return 0.0
    return 0.5 * (1.0 + erf((separation - decides) / (2.0 * sqrt(2.0 * separation))))


def repeats_needed(separation: float, enough: float = ENOUGH, most: int = 1000) -> int | None:
    """Return how many such trips decide with a chance of ``enough``; None if not even ``most``.

    Examples
    --------
    >>> repeats_needed(20.0), repeats_needed(2.0), repeats_needed(1e-6)
    (1, 6, None)
    """
    if chance(most * separation) < enough:
        return None
    low, high = 1, most
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if chance(middle * separation) >= enough else (middle + 1, high)
    return low


@dataclass(frozen=True, kw_only=True)
class Proposal:
    """A trip and how well it would distinguish two explanations.

    Parameters
    ----------
    trip : TripPlan
    separation : float
        D.
    power : float
        Chance that one such trip decides.
    repeats : int or None
        Trips for a chance of 80 %; None: more than a thousand.
    duration : float, s
    """

    trip: TripPlan
    separation: float
    power: float
    repeats: int | None
    duration: float

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, for ``diagnosis.json``."""
        return {
            "trip": str(self.trip),
            "words": self.trip.words,
            "separation": self.separation,
            "power": self.power,
            "trips_for_80_percent": self.repeats,
            "duration_s": self.duration,
        }


@dataclass(frozen=True, kw_only=True)
class NextMeasurement:
    """What to measure to distinguish two explanations.

    Parameters
    ----------
    best, rival : str
        ``kind@where``.
    titles : tuple of str
        The same in words.
    record : str
        Record whose inputs the trips are made from.
    proposals : tuple of Proposal
        By separation; the recorded trip itself is among them.
    why_not : str
        Why nothing could be proposed, if so.
    """

    best: str
    rival: str
    titles: tuple[str, str]
    record: str = ""
    proposals: tuple[Proposal, ...] = ()
    why_not: str = ""

    @property
    def purpose(self) -> str:
        """What it is for."""
        return f"To tell {self.titles[0]} from {self.titles[1]}"

    @property
    def sentence(self) -> str:
        """What to do, in a sentence or two."""
        purpose = self.purpose
        if not self.proposals:
            return f"{purpose}: {self.why_not}."
        top = self.proposals[0]
        if top.repeats is None:
            return (
                f"{purpose}: none of {count_text(len(self.proposals), 'trip')} with these or other sensors "
                "distinguishes them; they look the same to every output of the model."
            )
        many = "one trip" if top.repeats == 1 else f"{top.repeats} trips"
        text = (
            f"{purpose}: take {many} like {self.record}, {top.trip.words} ({top.duration:.3g} s; one decides with a "
            f"chance of {'over 99' if top.power > 0.995 else f'{100 * top.power:.0f}'} %)."
        )
        if top.trip.sensor:
            plain = next((p for p in self.proposals if not p.trip.sensor), None)
            if plain is not None and plain.repeats is not None:
                text += f" With the present sensors: {plain.trip.words}, {plain.repeats} of them."
            else:
                text += " No trip with the present sensors distinguishes them."
        usual = next((p for p in self.proposals if p.trip == TripPlan()), None)
        if usual is not None and usual is not top:
            need = f"{usual.repeats} of them" if usual.repeats is not None else "no number of them is enough"
            text += f" Trips as recorded: {need}."
        return text

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, for ``diagnosis.json``."""
        return {
            "best": self.best,
            "rival": self.rival,
            "record": self.record,
            "sentence": self.sentence,
            "trips": [p.to_dict() for p in self.proposals],
        }

    def to_frame(self) -> pd.DataFrame:
        """Return a table of the trips."""
        import pandas as pd

        return pd.DataFrame([p.to_dict() for p in self.proposals])

    def __repr__(self) -> str:
        lines = [f"NextMeasurement: {self.sentence}"]
        lines += [f"  {p.trip.words:55s} D = {p.separation:8.3g}  power {p.power:.0%}" for p in self.proposals]
        return "\n".join(lines)
