"""A real recording of a gear stage: which lines it has, which shaft modulates the mesh, and how much that explains.

The recording is compared with a healthy model, which has mesh lines only, and with one whose mesh is modulated once and
several times a turn of a shaft: fitted on the first part of the recording, judged on the rest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gearbox.signals.main_components import MainComponents, main_components
from gearbox.signals.mesh_lines import find_mesh_frequency, fit_lines
from gearbox.signals.orders import SynchronousAverage, order_track, revolutions_from_mesh, synchronous_average
from gearbox.signals.signal import Signal, SignalError
from gearbox.signals.spectrum import LineTable, name_lines, shaft_frequencies, spectrum

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Explained", "RecordingAnalysis", "analyse", "families", "read_npz"]

Array = NDArray[np.float64]


def read_npz(path: str | Path, rate: str = "fs_Hz", unit: str = "m/s**2") -> dict[str, Signal]:
    """Read channels of one rate from a NumPy archive.

    Parameters
    ----------
    path : path
    rate : str
        Name of the entry that holds the sampling rate, Hz.
    unit : str
        Of the channels.

    Raises
    ------
    SignalError
        If the rate is missing.
    """
    path = Path(path)
    with np.load(path, allow_pickle=False) as archive:
        if rate not in archive.files:
            raise SignalError(f"{path.name}: has no '{rate}' with the sampling rate; it has {', '.join(archive.files)}")
        fs = float(archive[rate])
        return {
            n: Signal(archive[n], fs, name=n, unit=unit) for n in archive.files if n != rate and archive[n].ndim == 1
        }


@dataclass(frozen=True)
class Explained:
    """Share of the energy of data not used that a set of lines explains.

    Parameters
    ----------
    name : str
        What the lines are.
    lines : int
        How many.
    fitted, held_out : float
        Share explained in the part that was fitted and in the part that was not.
    """

    name: str
    lines: int
    fitted: float
    held_out: float


@dataclass(frozen=True, eq=False, kw_only=True)
class RecordingAnalysis:
    """What one channel of a recording says.

    Parameters
    ----------
    signal : Signal
    mesh_frequency : float, Hz
        Found in the recording.
    components : MainComponents
        Highest peaks against the nominal mesh frequency.
    lines : LineTable
    explained : tuple of Explained
        Mesh lines only; with sidebands; everything that repeats with the slower shaft.
    average : SynchronousAverage
        Over a turn of the slower shaft.
    unexplained : tuple of (float, float)
        Frequency (Hz) and amplitude of the highest peaks that are neither mesh lines nor sidebands.
    """

    signal: Signal
    mesh_frequency: float
    components: MainComponents
    lines: LineTable
    explained: tuple[Explained, ...]
    average: SynchronousAverage
    unexplained: tuple[tuple[float, float], ...]

    def __repr__(self) -> str:
        return f"RecordingAnalysis({self.statement()})"

    def statement(self) -> str:
        """What is missing in a healthy model, on which shaft, and what it explains."""
        shaft = self.lines.modulating_shaft()
        detected = [line for line in self.lines.mesh if line.found]
        text = (
            f"{self.signal.name}: mesh at {self.mesh_frequency:.2f} Hz with {len(detected)} of {len(self.lines.mesh)} "
            "harmonics found; "
        )
        if not shaft:
            return text + "no shaft modulates it."
        table = self.lines.modulation()[shaft]
        text += (
            f"modulated at the frequency of the {shaft}, {self.lines.shafts[shaft]:.2f} Hz ({table['found']:.0f} of "
            f"{table['looked_for']:.0f} sidebands that no other shaft explains): eccentricity or another error once a "
            f"turn of the {shaft}"
        )
        before, after = self.explained[0].held_out, self.explained[1].held_out
        text += f". On data not used, mesh lines explain {100 * before:.1f} % of the energy, with sidebands "
        return text + f"{100 * after:.1f} %."

    def to_frame(self) -> pd.DataFrame:
        """Share of the energy explained, fitted and held out."""
        import pandas as pd

        return pd.DataFrame(
            [
                {"lines": e.name, "number": e.lines, "fitted part": e.fitted, "held-out part": e.held_out}
                for e in self.explained
            ]
        )

    def plot(self, **options: Any) -> Any:
        """Spectrum with mesh orders and sidebands marked; returns the figure."""
        top = (max(line.mesh_order for line in self.lines.mesh) + 0.5) * self.mesh_frequency
        return spectrum(self.signal).plot(self.lines, **{"band": (0.0, top), **options})


def analyse(
    signal: Signal,
    speed_hz: float,
    teeth: tuple[int, int],
    *,
    names: tuple[str, str] = ("pinion shaft", "gear shaft"),
    harmonics: int = 5,
    sidebands: int = 3,
    split: float = 0.5,
    reference: Signal | None = None,
    within: float = 0.01,
) -> RecordingAnalysis:
    """Analyse one channel of a single gear stage at constant speed.

    Parameters
    ----------
    signal : Signal
    speed_hz : float
        Nominal rotation frequency of the driving shaft, Hz.
    teeth : (int, int)
        Of the driving and the driven gear.
    names : (str, str)
        Of their shafts.
    harmonics, sidebands : int
        Looked for.
    split : float
        Share of the recording that is fitted; the rest is held out.
    reference : Signal, optional
        Channel, recorded at the same time, whose mesh line gives the shaft's angle; default: the signal itself.
    within : float
        Search range of the mesh frequency, as a share.

    Notes
    -----
    The angle of the held-out part comes from its own mesh line, as any alignment of a model with a recording must come
    from the recording; amplitudes and phases of all lines come from the fitted part alone.
    """
    nominal = teeth[0] * speed_hz
    mesh = find_mesh_frequency(signal, nominal, within=within)
    shafts = shaft_frequencies(mesh, teeth, names)
    lines = name_lines(signal, mesh, shafts, harmonics=harmonics, sidebands=sidebands)
    components = main_components(signal, nominal)
    slow = int(np.argmax(teeth))
    guide = signal if reference is None else reference
    strongest = max(name_lines(guide, mesh, {}, harmonics=harmonics, sidebands=0).mesh, key=lambda line: line.amplitude)
    turns = revolutions_from_mesh(
        guide, mesh, teeth[slow], bandwidth=0.36 * shafts[names[slow]], harmonic=strongest.mesh_order
    )
    highest = harmonics * teeth[slow] + 2 * sidebands
    per_turn = 2 ** int(np.ceil(np.log2(2.5 * highest)))
    tracked = order_track(signal, turns, per_turn)
    # The filter that follows the phase has not settled at the ends.
    whole = int(np.floor(len(tracked) / tracked.rate)) - 4
    first = round(split * whole)
    begin = np.ceil(tracked.start + 2.0) - tracked.start
    parts = (tracked.cut(begin, first), tracked.cut(begin + first, whole - first))
    fast_order = max(teeth) / min(teeth)
    mesh_orders = [float(k * teeth[slow]) for k in range(1, harmonics + 1)]
    own = [k + n for k in mesh_orders for n in range(-sidebands, sidebands + 1) if n]
    other = [k + n * fast_order for k in mesh_orders for n in range(-sidebands, sidebands + 1) if n]
    sides = _distinct(own + other, mesh_orders)
    families_of_orders = (
        ("mesh lines only (a healthy model)", mesh_orders),
        (f"and sidebands of the {names[slow]} and the {names[1 - slow]}", sorted(mesh_orders + sides)),
        (f"everything that repeats with the {names[slow]}", None),
    )
    return RecordingAnalysis(
        signal=signal,
        mesh_frequency=mesh,
        components=components,
        lines=lines,
        explained=tuple(_judged(name, parts, orders, begin, first) for name, orders in families_of_orders),
        average=synchronous_average(tracked.cut(begin, whole)),
        unexplained=_unexplained(signal, lines),
    )


def _distinct(orders: Sequence[float], taken: Sequence[float]) -> list[float]:
    distinct: list[float] = []
    for order in sorted(orders):
        if order > 0.5 and all(abs(order - o) > 0.05 for o in (*distinct, *taken)):
            distinct.append(order)
    return distinct


def _judged(
    name: str, parts: tuple[Signal, Signal], orders: Sequence[float] | None, begin: float, first: int
) -> Explained:
    """Fit lines to the first part and compare them with the second, which begins ``first`` whole turns later."""
    a, b = parts
    if orders is None:
        average = synchronous_average(a)
        lines = average.values.size // 2
        predicted = [np.tile(average.values, len(part) // average.values.size) for part in parts]
    else:
        fit = fit_lines(a, orders)
        lines = len(orders)
        # All of these orders are the same after whole turns but for a gear ratio that is no whole number.
        predicted = [
            fit.values_at(np.arange(len(a)) / a.rate),
            fit.values_at(first + np.arange(len(b)) / b.rate),
        ]
    shares = []
    for part, model in zip(parts, predicted, strict=True):
        y = part.values[: model.size] - part.values[: model.size].mean()
        shares.append(1.0 - float(((y - model) ** 2).sum()) / float((y**2).sum()))
    return Explained(name, lines, shares[0], shares[1])


def _unexplained(signal: Signal, lines: LineTable, count: int = 8) -> tuple[tuple[float, float], ...]:
    from scipy.signal import find_peaks

    whole = spectrum(signal)
    top = (max(line.mesh_order for line in lines.mesh) + 0.5) * lines.mesh_frequency
    inside = whole.frequencies <= top
    f, a = whole.frequencies[inside], whole.amplitudes[inside].copy()
    for line in lines.lines:
        a[np.abs(f - line.frequency) <= 2.0 * whole.resolution] = 0.0
    slowest = min(lines.shafts.values())
    orders = f / slowest
    a[np.abs(orders - np.round(orders)) * slowest <= 1.5 * whole.resolution] = 0.0
    peaks, _ = find_peaks(a, distance=max(1, round(2.0 * whole.resolution / whole.step)))
    peaks = peaks[np.argsort(-a[peaks])][:count]
    return tuple((float(f[i]), float(a[i])) for i in peaks)


def families(analyses: Mapping[str, RecordingAnalysis], tolerance: float = 0.4) -> pd.DataFrame:
    """Distances from the nearest mesh line that come back among the unexplained peaks of several channels.

    A distance that recurs at several mesh lines or channels is a modulation by something that turns at that frequency;
    which part it is, needs the bearings' geometry.
    """
    import pandas as pd

    rows: list[dict[str, Any]] = []
    for channel, analysis in analyses.items():
        for f, a in analysis.unexplained:
            k = round(f / analysis.mesh_frequency)
            rows.append(
                {"distance": abs(f - k * analysis.mesh_frequency), "mesh_order": k, "channel": channel, "amplitude": a}
            )
    rows.sort(key=lambda row: row["distance"])
    groups: list[list[dict[str, Any]]] = []
    for row in rows:
        if groups and row["distance"] - groups[-1][-1]["distance"] <= tolerance:
            groups[-1].append(row)
        else:
            groups.append([row])
    table = [
        {
            "distance [Hz]": float(np.mean([r["distance"] for r in g])),
            "times seen": len(g),
            "at mesh orders": ", ".join(str(k) for k in sorted({r["mesh_order"] for r in g})),
            "channels": ", ".join(sorted({r["channel"] for r in g})),
            "largest amplitude": max(r["amplitude"] for r in g),
        }
        for g in groups
    ]
    return pd.DataFrame(table).sort_values("largest amplitude", ascending=False, ignore_index=True)
