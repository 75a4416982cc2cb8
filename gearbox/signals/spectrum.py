"""Spectra of a gear stage: its mesh lines and sidebands found and named.

A line counts as found when noise as strong as its neighbourhood would give one so high with a small probability.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gearbox.signals.figures import plot_spectrum
from gearbox.signals.signal import Signal, SignalError

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Line",
    "LineTable",
    "Spectrum",
    "name_lines",
    "shaft_frequencies",
    "spectrum",
]

Array = NDArray[np.float64]

#: Probability that noise alone gives a line as high, over all lines looked for.
_LUCK = 1e-3
#: Sidebands of other shafts up to this number may be what is seen at a line.
_ALSO = 6


@dataclass(frozen=True, eq=False, kw_only=True)
class Spectrum:
    """One-sided amplitude spectrum.

    Parameters
    ----------
    frequencies : ndarray, shape (m,), Hz
        Or orders, for a tracked signal.
    amplitudes : ndarray, shape (m,)
        Peak value of a sine at that frequency, in the signal's unit.
    resolution : float, Hz
        Width of a line at half its height.
    unit, name : str
    """

    frequencies: Array
    amplitudes: Array
    resolution: float
    unit: str = ""
    name: str = ""

    @property
    def step(self) -> float:
        """Distance of two frequencies, Hz."""
        return float(self.frequencies[1] - self.frequencies[0])

    def to_frame(self) -> pd.DataFrame:
        """Frequencies and amplitudes as a table."""
        import pandas as pd

        return pd.DataFrame(
            {"frequency [Hz]": self.frequencies, f"amplitude, peak [{self.unit or '-'}]": self.amplitudes}
        )

    def noise(self, frequency: float, width: float = 40.0) -> float:
        """Noise around a frequency: the Rayleigh parameter σ of the amplitudes, from their median.

        Parameters
        ----------
        frequency : float, Hz
        width : float
            Half the neighbourhood, in resolutions; three resolutions at the frequency itself are left out.
        """
        distance = np.abs(self.frequencies - frequency)
        around = (distance <= width * self.resolution) & (distance > 3.0 * self.resolution)
        if not around.any():
            return 0.0
        # The median of a Rayleigh distribution is σ √(2 ln 2); other lines nearby hardly move a median.
        return float(np.median(self.amplitudes[around]) / np.sqrt(2.0 * np.log(2.0)))

    def plot(self, lines: LineTable | None = None, **options: Any) -> Any:
        """The spectrum with lines marked; returns the figure."""
        return plot_spectrum(self, lines, **options)


def spectrum(signal: Signal, window: str = "hann") -> Spectrum:
    """Amplitude spectrum of a signal without its mean.

    Parameters
    ----------
    signal : Signal
    window : str
        Any window of ``scipy.signal.get_window``.

    Examples
    --------
    >>> import numpy as np
    >>> s = spectrum(Signal(3.0 * np.sin(2 * np.pi * 50.0 * np.arange(1000) / 1000.0), 1000.0))
    >>> float(s.frequencies[s.amplitudes.argmax()]), round(float(s.amplitudes.max()), 6)
    (50.0, 3.0)
    """
    from scipy.signal import get_window

    w = get_window(window, len(signal), fftbins=True)
    values = (signal.values - signal.values.mean()) * w
    amplitudes = np.asarray(2.0 * np.abs(np.fft.rfft(values)) / w.sum())
    width = len(signal) * float((w**2).sum() / w.sum() ** 2) / signal.duration
    return Spectrum(
        frequencies=np.asarray(np.fft.rfftfreq(len(signal), 1.0 / signal.rate)),
        amplitudes=amplitudes,
        resolution=width,
        unit=signal.unit,
        name=signal.name,
    )


@dataclass(frozen=True, kw_only=True)
class Line:
    """A line that was looked for.

    Parameters
    ----------
    name : str
        Such as ``"2 × mesh − 1 × output shaft"``.
    frequency : float, Hz
        Where theory puts it.
    mesh_order : int
        Multiple of the mesh frequency; 0 for a line of a shaft alone.
    shaft : str
        Whose sideband it is; ``""`` for a mesh line.
    sideband : int
        Its number, with sign; 0 for a mesh line.
    also : tuple of str
        Other names of the same frequency.
    amplitude : float
        Largest amplitude within one resolution, peak.
    noise : float
        Rayleigh parameter of the neighbourhood.
    found : bool
    """

    name: str
    frequency: float
    mesh_order: int
    shaft: str
    sideband: int
    also: tuple[str, ...]
    amplitude: float
    noise: float
    found: bool


@dataclass(frozen=True)
class LineTable:
    """Mesh lines and sidebands of a signal.

    Parameters
    ----------
    lines : tuple of Line
    mesh_frequency : float, Hz
    shafts : mapping of str to float
        Rotation frequencies, Hz.
    unit : str
    """

    lines: tuple[Line, ...]
    mesh_frequency: float
    shafts: Mapping[str, float]
    unit: str = ""

    def to_frame(self) -> pd.DataFrame:
        """One row for each line."""
        import pandas as pd

        rows = [
            {
                "line": line.name,
                "also": ", ".join(line.also),
                "frequency [Hz]": line.frequency,
                f"amplitude, peak [{self.unit or '-'}]": line.amplitude,
                "over noise": line.amplitude / line.noise if line.noise > 0.0 else np.inf,
                "found": line.found,
            }
            for line in self.lines
        ]
        return pd.DataFrame(rows)

    @property
    def mesh(self) -> tuple[Line, ...]:
        """The mesh lines."""
        return tuple(line for line in self.lines if line.shaft == "" and line.mesh_order)

    def sidebands(self, shaft: str, *, own: bool = False) -> tuple[Line, ...]:
        """Sidebands of a shaft; with ``own`` only those that no other shaft explains."""
        return tuple(line for line in self.lines if line.shaft == shaft and not (own and line.also))

    def modulation(self) -> dict[str, dict[str, float]]:
        """How strongly each shaft modulates the mesh, judged by sidebands that no other shaft explains.

        Returns
        -------
        dict
            For each shaft ``found`` and ``looked_for`` (numbers of own sidebands), ``amplitude`` (root sum of squares
            of the found ones) and ``share`` (of the mesh lines' root sum of squares).
        """
        carrier = float(np.sqrt(sum(line.amplitude**2 for line in self.mesh)))
        table = {}
        for shaft in self.shafts:
            own = [line for line in self.sidebands(shaft, own=True) if line.mesh_order]
            size = float(np.sqrt(sum(line.amplitude**2 for line in own if line.found)))
            table[shaft] = {
                "found": sum(bool(line.found) for line in own),
                "looked_for": len(own),
                "amplitude": size,
                "share": size / carrier if carrier > 0.0 else float("nan"),
            }
        return table

    def modulating_shaft(self) -> str:
        """The shaft whose own sidebands stand out most, or ``""`` if fewer than a third of any shaft's were found."""
        table = self.modulation()
        seen = {s: row for s, row in table.items() if row["found"] >= max(1, row["looked_for"] / 3)}
        return max(seen, key=lambda s: seen[s]["share"]) if seen else ""


def name_lines(
    signal: Signal,
    mesh_frequency: float,
    shafts: Mapping[str, float],
    *,
    harmonics: int = 5,
    sidebands: int = 2,
) -> LineTable:
    """Look for mesh lines and sidebands, and name them.

    Parameters
    ----------
    signal : Signal
        Long enough to resolve the slowest shaft: at least four of its turns.
    mesh_frequency : float, Hz
    shafts : mapping of str to float
        Rotation frequencies, Hz.
    harmonics : int
        Mesh orders looked at, as far as the Nyquist frequency allows.
    sidebands : int
        On each side of each mesh line; 0 for none.

    Raises
    ------
    SignalError
        If the signal is too short to tell sidebands from mesh lines.
    """
    whole = spectrum(signal)
    slowest = min(shafts.values(), default=mesh_frequency)
    if sidebands and slowest < 4.0 * whole.resolution:
        raise SignalError(
            f"'{signal.name}' of {signal.duration:.3g} s resolves {whole.resolution:.3g} Hz, too little for sidebands "
            f"{slowest:.3g} Hz apart: take at least {6.0 / slowest:.2g} s"
        )
    wanted = _wanted(mesh_frequency, shafts, harmonics, sidebands)
    wanted = [w for w in wanted if whole.resolution < w.frequency < signal.nyquist - whole.resolution]
    named: list[_Wanted] = []
    # Where two shafts' sidebands fall together, the lower number names the line.
    for candidate in sorted(wanted, key=lambda w: (abs(w.sideband), w.frequency)):
        if all(abs(candidate.frequency - other.frequency) >= whole.resolution for other in named):
            named.append(candidate)
    far = _wanted(mesh_frequency, shafts, harmonics, max(sidebands, _ALSO)) if sidebands else []
    threshold = np.sqrt(-2.0 * np.log(_LUCK / max(len(named), 1) / 3.0))  # three bins are looked at for each line
    width = min(40.0, 3.0 * slowest / whole.resolution)
    lines = []
    for w in sorted(named, key=lambda w: w.frequency):
        near = np.abs(whole.frequencies - w.frequency) <= whole.resolution
        amplitude, noise = float(whole.amplitudes[near].max()), whole.noise(w.frequency, width)
        also = tuple(
            other.name
            for other in far
            if other.mesh_order == w.mesh_order
            and other.shaft not in ("", w.shaft)
            and abs(other.frequency - w.frequency) < whole.resolution
        )
        lines.append(
            Line(
                name=w.name,
                frequency=w.frequency,
                mesh_order=w.mesh_order,
                shaft=w.shaft,
                sideband=w.sideband,
                also=also,
                amplitude=amplitude,
                noise=noise,
                found=bool(amplitude > threshold * noise),
            )
        )
    return LineTable(tuple(lines), mesh_frequency, dict(shafts), signal.unit)


class _Wanted(NamedTuple):
    """A line to look for."""

    name: str
    frequency: float
    mesh_order: int
    shaft: str
    sideband: int


def _wanted(mesh: float, shafts: Mapping[str, float], harmonics: int, sidebands: int) -> list[_Wanted]:
    wanted = []
    for k in range(1, harmonics + 1):
        wanted.append(_Wanted(f"{k} × mesh", k * mesh, k, "", 0))
        for shaft, f in shafts.items():
            for n in [*range(-sidebands, 0), *range(1, sidebands + 1)]:
                sign = "+" if n > 0 else "−"
                wanted.append(_Wanted(f"{k} × mesh {sign} {abs(n)} × {shaft}", k * mesh + n * f, k, shaft, n))
    return wanted


def shaft_frequencies(mesh_frequency: float, teeth: Sequence[int], names: Sequence[str]) -> dict[str, float]:
    """Rotation frequency of each shaft from the mesh frequency and its gear's tooth number, Hz (Eq. 3)."""
    return {name: mesh_frequency / z for name, z in zip(names, teeth, strict=True)}
