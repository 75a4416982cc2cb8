"""The lines of the study of the alignment sensor: what is done to the recordings, and the scores of one lift."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from vtsdt.alignment.filter import TUNINGS, Tuning
from vtsdt.alignment.score import Score
from vtsdt.alignment.virtual_lifts import EVALUATED_TRIPS, LiftCase

__all__ = [
    "EVERY_LIFT",
    "FIRST_UNSEEN_SEED",
    "IF_SHORT",
    "TEN_TRIPS",
    "TWENTY_TRIPS",
    "UNDISTURBED",
    "LiftScores",
    "Line",
    "lines",
]

#: Lines that the page quotes.
TEN_TRIPS, UNDISTURBED, TWENTY_TRIPS = "ten trips, default tuning", "none, four trips", "20 trips"
#: Lines that every lift takes, and those that show why a lift falls short.
EVERY_LIFT, IF_SHORT = (TEN_TRIPS, "6 trips", "4 trips", "2 trips"), (UNDISTURBED, TWENTY_TRIPS)
#: Lifts with seeds from here on were not used while the method was developed.
FIRST_UNSEEN_SEED = 101
_TABLE_2 = TUNINGS["table2"]
#: Tunings that are compared with the default, and what they are.
COMPARED: dict[str, tuple[Tuning, str]] = {
    "table2": (_TABLE_2, "Table 2 as printed, Q per second"),
    "table2_steps": (
        dataclasses.replace(_TABLE_2, name="table2_steps", process={k: 1e3 * v for k, v in _TABLE_2.process.items()}),
        "Table 2 as printed, Q per step of 1 ms",
    ),
    "bounded": (TUNINGS["bounded"], "Table 2, a hundredth of it for the lateral states"),
    "likelihood": (TUNINGS["likelihood"], "found by marginal likelihood from two trips of another lift"),
}

Take = Callable[[LiftCase], Sequence[dict[str, np.ndarray]]]


@dataclass(frozen=True, kw_only=True)
class Line:
    """A line of the table: which recordings are taken, and what is done to them.

    Parameters
    ----------
    group, what : str
    take : callable
        Returns the recordings of a lift.
    errors : dict
        Added to the recordings; see `vtsdt.alignment.virtual_lifts.with_sensor_errors`.
    arguments : dict
        Of `vtsdt.alignment.estimate.align`.
    """

    group: str
    what: str
    take: Take = field(repr=False)
    errors: dict[str, Any] = field(default_factory=dict)
    arguments: dict[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Group and words."""
        return f"{self.group}: {self.what}"


@dataclass(frozen=True, kw_only=True)
class LiftScores:
    """The scores of one lift.

    Parameters
    ----------
    seed : int
    friction, mass : float
        True value over the nominal one; friction is the product of coefficient and stiffness.
    factor : float
        On friction, estimated by the scaling.
    spread : float, m
        Standard deviation of the true deviation over the heights that are evaluated.
    scores : dict of str to Score or str
        By the line's name; a text is the reason for which its trips are refused.
    """

    seed: int
    friction: float
    mass: float
    factor: float
    spread: float
    scores: dict[str, Score | str]

    def score(self, what: str) -> Score | None:
        """Return the score of a line by its words; None if its trips were refused or it was not run."""
        result = next((v for k, v in self.scores.items() if k.endswith(f": {what}")), None)
        return result if isinstance(result, Score) else None

    @classmethod
    def of(cls, stored: dict[str, Any]) -> LiftScores:
        """Return scores from the content of `dataclasses.asdict`."""
        scores = {k: v if isinstance(v, str) else Score.of(v) for k, v in stored["scores"].items()}
        return cls(**{**stored, "scores": scores})


def lines() -> Iterator[Line]:
    """Yield the lines of the table."""
    ten = partial(_first, count=EVALUATED_TRIPS)

    def on_ten_trips(group: str, what: str, errors: dict[str, Any], **arguments: Any) -> Line:
        return Line(group=group, what=what, take=ten, errors=errors, arguments=arguments)

    yield on_ten_trips("as recorded", TEN_TRIPS, {})
    for tuning, what in COMPARED.values():
        yield on_ten_trips("tuning", what, {}, tuning=tuning)
    yield on_ten_trips("smoother", "default tuning, smoothed backwards", {}, smooth=True)
    for size in (0.001, -0.003, 0.003, 0.01):
        yield on_ten_trips("gain of the tension", f"{100 * size:+g} %", {"tension_gain": size})
    for size in (0.003, 0.01):
        what = f"{100 * size:+g} %, not balanced"
        yield on_ten_trips("gain of the tension", what, {"tension_gain": size}, balanced=False)
    both = {"tension_gain": 0.01, "tension_offset": 3.0}
    yield on_ten_trips("gain and offset of the tension", "+1 %, 3 N", both)
    for offset in (3.0, 10.0):
        yield on_ten_trips("offset of the tension", f"{offset:g} N", {"tension_offset": offset})
    for noise in (1.0, 3.0):
        yield on_ten_trips("noise of the tension", f"{noise:g} N", {"tension_noise": noise})
    yield on_ten_trips("offset of the accelerometer", "0.3 m/s²", {"acceleration_offset": 0.3})
    for noise in (0.03, 0.1):
        yield on_ten_trips("noise of the accelerometer", f"{noise:g} m/s²", {"acceleration_noise": noise})
    for noise in (1.0, 5.0):
        yield on_ten_trips("height", f"noise of {noise:g} mm", {"height_noise": 1e-3 * noise})
    yield on_ten_trips("height", "offset of 20 mm", {"height_offset": 0.02})
    yield on_ten_trips("height", "gain of +1 %", {"height_gain": 0.01})
    other_trips: tuple[tuple[str, str, Take], ...] = (
        ("disturbing force", UNDISTURBED, lambda lift: lift.undisturbed.records),
        ("number of trips", TWENTY_TRIPS, lambda lift: (*lift.evaluated.records, *lift.further.records)),
        *(("number of trips", f"{count} trips", partial(_first, count=count)) for count in (6, 4, 2)),
        ("number of trips", "one trip up", partial(_first, count=1)),
        ("number of trips", "five trips, all up", lambda lift: lift.evaluated.records[:EVALUATED_TRIPS:2]),
    )
    for group, what, take in other_trips:
        yield Line(group=group, what=what, take=take)


def _first(lift: LiftCase, count: int) -> Sequence[dict[str, np.ndarray]]:
    return lift.evaluated.records[:count]
