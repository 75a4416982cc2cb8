"""Main components of a gear stage's vibration against theory: step 2 of the updating chain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gearbox.signals.signal import Signal, SignalError
from gearbox.signals.spectrum import spectrum

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["ACCEPTED_ERROR", "MainComponents", "main_components"]

Array = NDArray[np.float64]

#: The paper's acceptance limit for main components against theory (section 3.2).
ACCEPTED_ERROR = 0.05
#: Highest mesh order that the 5 % limit can judge: beyond it every frequency is within 5 % of some harmonic.
_HIGHEST_ORDER = 9


@dataclass(frozen=True, kw_only=True)
class MainComponents:
    """The highest peaks of a spectrum against multiples of the mesh frequency (Eq. 3).

    Parameters
    ----------
    mesh_frequency : float, Hz
        From theory.
    frequencies, amplitudes : tuple of float
        Of the peaks, highest first: Hz, and peak value in the signal's unit.
    orders : tuple of int
        Nearest multiple of the mesh frequency.
    errors : tuple of float
        Relative to that multiple.
    """

    mesh_frequency: float
    frequencies: tuple[float, ...]
    amplitudes: tuple[float, ...]
    orders: tuple[int, ...]
    errors: tuple[float, ...]

    @property
    def worst(self) -> float:
        """Largest relative error."""
        return max(abs(e) for e in self.errors)

    @property
    def accepted(self) -> bool:
        """Whether every main component is within 5 % of a multiple of the mesh frequency (section 3.2)."""
        return self.worst <= ACCEPTED_ERROR

    def to_frame(self) -> pd.DataFrame:
        """One row for each component, by frequency."""
        import pandas as pd

        rows = zip(self.frequencies, self.orders, self.errors, self.amplitudes, strict=True)
        return pd.DataFrame(
            [
                {
                    "theory [Hz]": k * self.mesh_frequency,
                    "found [Hz]": f,
                    "order": k,
                    "relative error": e,
                    "amplitude": a,
                }
                for f, k, e, a in sorted(rows)
            ]
        )


def main_components(signal: Signal, mesh_frequency: float, count: int = 3) -> MainComponents:
    """Compare the highest peaks with theory.

    Parameters
    ----------
    signal : Signal
    mesh_frequency : float, Hz
        z₁ f_n1 of the operating condition (Eq. 3).
    count : int
        How many peaks.  They are looked for up to the ninth mesh order: beyond it every frequency lies within 5 % of
        some multiple.

    Raises
    ------
    SignalError
        If the signal does not vary, or its spectrum has fewer peaks.
    """
    from scipy.signal import find_peaks

    whole = spectrum(signal)
    inside = whole.frequencies <= (_HIGHEST_ORDER + 0.5) * mesh_frequency
    a, f = whole.amplitudes[inside], whole.frequencies[inside]
    apart = max(1, round(0.25 * mesh_frequency / whole.step))
    peaks, _ = find_peaks(a, distance=apart)
    peaks = peaks[np.argsort(-a[peaks])][:count]
    if not a.max(initial=0.0) > 1e-12 * float(np.abs(signal.values).max()):
        raise SignalError(f"signal '{signal.name}' does not vary (zero variance): it has no main components")
    if peaks.size < count:
        raise SignalError(
            f"'{signal.name}' has {peaks.size} peaks below {f[-1]:.5g} Hz, fewer than the {count} asked for"
        )
    frequencies = [_between(a, f, int(i)) for i in peaks]
    orders = [max(1, round(frequency / mesh_frequency)) for frequency in frequencies]
    errors = [frequency / (k * mesh_frequency) - 1.0 for frequency, k in zip(frequencies, orders, strict=True)]
    return MainComponents(
        mesh_frequency=mesh_frequency,
        frequencies=tuple(frequencies),
        amplitudes=tuple(a[peaks].tolist()),
        orders=tuple(orders),
        errors=tuple(errors),
    )


def _between(a: Array, f: Array, i: int) -> float:
    """Frequency of a peak between two bins, by a parabola through the logarithms (exact for a Gaussian window)."""
    if i in (0, a.size - 1) or min(a[i - 1], a[i + 1]) <= 0.0:
        return float(f[i])
    left, centre, right = np.log(a[i - 1 : i + 2])
    return float(f[i] + 0.5 * (left - right) / (left - 2.0 * centre + right) * (f[1] - f[0]))
