"""A change of a recorded trip: speed, way, side, stops, load, or a sensor more."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

__all__ = ["TripPlan"]

#: How long the machine stands at a stop, and how long it takes to come to it, s.
STOP, RAMP = 0.6, 0.2


@dataclass(frozen=True, kw_only=True)
class TripPlan:
    """How a trip differs from a recorded one.

    Parameters
    ----------
    speed : float
        Factor on the speed: the inputs run through in 1/speed of the time.
    amplitude : float
        Factor on the way of each input from its first value.
    mirror : bool
        To the other side: each input turned about its first value.
    stops : int
        Stops on the way, evenly over what the inputs go through.
    load : float
        Factor on the machine's load (a mass).
    sensor : str
        Output that is measured in addition.

    Examples
    --------
    >>> plan = TripPlan.parse("speed=0.5, stops=2, mirror")
    >>> plan.words
    'at 0.5 times the speed, to the other side, with 2 stops on the way'
    >>> str(plan)
    'speed=0.5,mirror,stops=2'
    """

    speed: float = 1.0
    amplitude: float = 1.0
    mirror: bool = False
    stops: int = 0
    load: float = 1.0
    sensor: str = ""

    def __post_init__(self) -> None:
        faults = [
            f"{n} of a trip is {getattr(self, n)}: give a factor above zero"
            for n in ("speed", "amplitude", "load")
            if not (np.isfinite(getattr(self, n)) and getattr(self, n) > 0.0)
        ]
        if not 0 <= self.stops <= 50:
            faults.append(f"stops of a trip is {self.stops}: give 0 to 50")
        if faults:
            raise ValueError("; ".join(faults))

    @classmethod
    def parse(cls, text: str) -> TripPlan:
        """Return a plan from words such as ``speed=0.5,mirror,stops=2,load=1.5,sensor=coupling.torque``.

        Raises
        ------
        ValueError
            With every word that is not understood.
        """
        known = {f.name: f.type for f in fields(cls)}
        values: dict[str, object] = {}
        faults = []
        for word in (w.strip() for w in text.split(",") if w.strip()):
            name, _, given = (x.strip() for x in word.partition("="))
            try:
                if name == "mirror" and not given:
                    values[name] = True
                elif name in ("speed", "amplitude", "load"):
                    values[name] = float(given)
                elif name == "stops":
                    values[name] = int(given)
                elif name == "sensor" and given:
                    values[name] = given
                else:
                    raise ValueError
            except ValueError:
                faults.append(f"'{word}' says nothing about a trip: take {', '.join(known)}, as in speed=0.5,mirror")
        if faults:
            raise ValueError("; ".join(faults))
        return cls(**values)  # type: ignore[arg-type]

    def __str__(self) -> str:
        parts = [
            f"{n}={getattr(self, n):g}" if n != "mirror" else n
            for n, usual in (("speed", 1.0), ("amplitude", 1.0), ("mirror", False), ("stops", 0), ("load", 1.0))
            if getattr(self, n) != usual
        ]
        return ",".join([*parts, *([f"sensor={self.sensor}"] if self.sensor else [])])

    @property
    def words(self) -> str:
        """What changes, in words; ``"as recorded"`` if nothing does."""
        parts = []
        if self.speed != 1.0:
            parts.append(f"at {self.speed:g} times the speed")
        if self.amplitude != 1.0:
            parts.append(f"over {self.amplitude:g} times the way")
        if self.mirror:
            parts.append("to the other side")
        if self.stops:
            parts.append(f"with {self.stops} stop{'s' if self.stops > 1 else ''} on the way")
        if self.load != 1.0:
            parts.append(f"with {self.load:g} times the load")
        if self.sensor:
            parts.append(f"with {self.sensor} measured as well")
        return ", ".join(parts) or "as recorded"

    def apply(self, time: np.ndarray, inputs: Mapping[str, np.ndarray]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return the times and inputs of the changed trip, sampled as densely as the recorded one.

        Parameters
        ----------
        time : ndarray, shape (n,), s
        inputs : mapping of str to ndarray, shape (n,)
        """
        time = np.asarray(time, dtype=float)
        step = float(np.median(np.diff(time)))
        turned = {
            n: u[0] + (-1.0 if self.mirror else 1.0) * self.amplitude * (np.asarray(u, dtype=float) - u[0])
            for n, u in inputs.items()
        }
        if self.speed == 1.0 and not self.stops:
            return time, turned
        clock = self._clock(time, turned, step)
        grid = time[0] + np.arange(clock.size) * step
        return grid, {n: np.interp(clock, time, u) for n, u in turned.items()}

    def _clock(self, time: np.ndarray, inputs: Mapping[str, np.ndarray], step: float) -> np.ndarray:
        """Return the recorded time at which the changed trip is, at each of its own instants."""
        ways = []
        for u in inputs.values():
            gone = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(u)))])
            if gone[-1] > 0.0:
                ways.append(gone / gone[-1])
        way = np.mean(ways, axis=0) if ways else np.linspace(0.0, 1.0, time.size)
        at = [float(np.interp((k + 1) / (self.stops + 1), way, time)) for k in range(self.stops)]
        pace, now, clock = step * self.speed, float(time[0]), []
        stopped = 0.0
        while now < time[-1]:
            clock.append(now)
            if at and now >= at[0]:
                # slow down, stand, and speed up again along a raised cosine, so that no input jumps
                stopped += step
                if stopped >= STOP + 2 * RAMP:
                    at.pop(0)
                    stopped = 0.0
                inside = max(min(stopped, STOP + 2 * RAMP - stopped), 0.0)
                now += pace * (0.5 * (1.0 + np.cos(np.pi * min(inside / RAMP, 1.0))))
            else:
                now += pace
        clock.append(float(time[-1]))
        return np.array(clock)
