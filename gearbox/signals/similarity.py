"""Cosine similarity of two vibration signals (gearbox paper, Eq. 8), with its alignment in time made explicit.

Two recordings have no common zero of time, so a lag has to be chosen, and the choice is part of the score: over all
lags the cosine runs far below zero and up to its maximum.  Every :class:`Similarity` therefore says by which rule the
lag was chosen, how large it is, how the speeds were matched, and which value no healthy model could exceed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gearbox.signals.mesh_lines import energy_share, harmonics_in
from gearbox.signals.signal import Signal, SignalError, value_at

__all__ = [
    "LAG_RULES",
    "LagRule",
    "Similarity",
    "bound_of_mesh_lines",
    "cosine",
    "cosine_over_lags",
    "match_speed",
    "similarity",
    "upper_bound",
]

Array = NDArray[np.float64]
LagRule = Literal["best", "mesh", "held", "none"]

LAG_RULES: dict[str, str] = {
    "best": "the lag of the highest cosine within the search range, found for this comparison alone",
    "mesh": "the lag at which the first mesh line in the band has the same phase in both signals",
    "held": "a lag that was found once, for the model before updating, and kept",
    "none": "no lag: the signals as they stand in their files",
}
#: Trial lags for each sample; a peak is 2 samples wide at 10 kHz.
_FINE = 8
_EDGE = 24


def _checked(x: Signal, y: Signal) -> None:
    if x.rate != y.rate:
        raise SignalError(
            f"'{x.name}' is sampled at {x.rate:g} Hz and '{y.name}' at {y.rate:g} Hz: resample both to one rate first"
        )
    if len(x) != len(y):
        raise SignalError(
            f"'{x.name}' has {len(x)} samples and '{y.name}' has {len(y)}: cut both to the same window first"
        )
    for signal in (x, y):
        if np.ptp(signal.values) <= 1e-12 * max(float(np.abs(signal.values).max()), 1e-300):
            raise SignalError(f"signal '{signal.name}' does not vary (zero variance): its direction is undefined")


def cosine(x: Signal, y: Signal) -> float:
    """Cosine similarity of two signals as they stand, −1 to 1 (Eq. 8).

    Raises
    ------
    SignalError
        If lengths or rates differ, or a signal does not vary.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(1000) / 1000.0
    >>> x, y = Signal(np.sin(50 * t), 1000.0), Signal(3.0 * np.sin(50 * t), 1000.0)
    >>> round(cosine(x, y), 6)
    1.0
    """
    _checked(x, y)
    return float(x.values @ y.values / np.sqrt((x.values @ x.values) * (y.values @ y.values)))


def _longest_lag(x: Signal, max_lag: float) -> int:
    """Whole samples that the search may use; at least a fifth of the window must stay."""
    reach = int(np.ceil(max_lag * x.rate)) + _EDGE
    if not max_lag >= 0.0 or 2 * reach > 0.8 * len(x):
        raise SignalError(
            f"a lag of up to {max_lag:.4g} s leaves too little of a window of {x.duration:.4g} s: take a longer window "
            f"or a smaller search range"
        )
    return reach


def cosine_over_lags(measured: Signal, virtual: Signal, max_lag: float) -> tuple[Array, Array]:
    """Cosine of measured(t) with virtual(t + lag) for lags an eighth of a sample apart.

    The middle of the measured window is compared, so that every lag compares the same measured samples.

    Parameters
    ----------
    measured, virtual : Signal
        Of the same rate and length.
    max_lag : float, s
        Lags from ``-max_lag`` to ``max_lag``.

    Returns
    -------
    lags : ndarray, shape (m,), s
    cosines : ndarray, shape (m,)
    """
    from scipy.signal import resample_poly

    _checked(measured, virtual)
    reach = _longest_lag(measured, max_lag)
    x = measured.values[reach:-reach]
    padded = np.pad(virtual.values, _EDGE, mode="reflect", reflect_type="odd")
    fine = resample_poly(padded, _FINE, 1, window=("kaiser", 9.0))
    furthest = int(np.floor(max_lag * measured.rate * _FINE))
    steps = np.arange(-furthest, furthest + 1)
    begins = (reach + _EDGE) * _FINE + steps
    size = float(np.sqrt(x @ x))
    cosines = np.empty(steps.size)
    for phase in range(_FINE):
        here = begins % _FINE == phase
        if not here.any():
            continue
        first = begins[here] // _FINE
        row = np.ascontiguousarray(fine[phase::_FINE][first[0] : first[-1] + x.size])
        power = np.concatenate([[0.0], np.cumsum(row**2)])
        left = power[x.size :] - power[: -x.size]
        cosines[here] = np.correlate(row, x, "valid") / (size * np.sqrt(left))
    return steps / (measured.rate * _FINE), cosines


def _cosine_at(measured: Signal, virtual: Signal, lag: float, reach: int) -> float:
    """Cosine at one lag, to the accuracy of a band-limited shift."""
    x = measured.values[reach:-reach]
    t = (np.arange(reach, len(measured) - reach)) / measured.rate + lag
    y = value_at(virtual, t)
    return float(x @ y / np.sqrt((x @ x) * (y @ y)))


def _peak(lags: Array, values: Array) -> tuple[float, float]:
    """Highest point with a parabola through its neighbours: place and value."""
    k = int(np.argmax(values))
    if k in (0, values.size - 1):
        return float(lags[k]), float(values[k])
    left, centre, right = values[k - 1 : k + 2]
    bend = left - 2.0 * centre + right
    shift = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return float(lags[k] + shift * (lags[1] - lags[0])), float(centre - 0.25 * (left - right) * shift)


def match_speed(virtual: Signal, virtual_mesh: float, measured_mesh: float) -> Signal:
    """Stretch a signal in time so that its mesh frequency becomes that of the measurement.

    A speed that differs by 0.1 % turns the second mesh line by a full turn in 1 s, which lowers any cosine.  Stretching
    moves resonances by the same share: for more than some thousandths simulate again at the measured speed.

    Raises
    ------
    SignalError
        If the frequencies differ by more than 2 %: then it is another operating condition.
    """
    ratio = measured_mesh / virtual_mesh
    if not abs(ratio - 1.0) <= 0.02:
        raise SignalError(
            f"mesh frequencies {measured_mesh:.6g} Hz (measured) and {virtual_mesh:.6g} Hz (model) differ by "
            f"{100 * (ratio - 1.0):+.2f} %: simulate at the measured speed"
        )
    if ratio == 1.0:
        return virtual
    # The same number of samples at a slightly different instant; beyond the end the last ones are mirrored.
    times = np.arange(len(virtual)) * (ratio / virtual.rate)
    inside = times <= (len(virtual) - 1) / virtual.rate
    values = value_at(virtual, times[inside])
    missing = int((~inside).sum())
    if missing:
        values = np.concatenate([values, 2.0 * values[-1] - values[-2 : -2 - missing : -1]])
    return virtual.with_values(values)


def upper_bound(measured: Signal, mesh_frequency: float, band: tuple[float, float]) -> tuple[float, float]:
    """The highest cosine that a signal with mesh lines only can reach, and the energy share behind it.

    A healthy model vibrates at multiples of the mesh frequency.  The projection of the measured signal onto these lines
    is the best that any of its parameters can give: cosine = √share.  Lines outside the band count too: what the filter
    leaves of them is in both signals.

    Returns
    -------
    bound, share : float
        Both 0 to 1.

    Raises
    ------
    SignalError
        If no mesh line lies in the band.
    """
    if not harmonics_in(mesh_frequency, *band).size:
        raise SignalError(
            f"no multiple of the mesh frequency {mesh_frequency:.5g} Hz lies in the band {band[0]:g} to {band[1]:g} "
            "Hz: widen the band"
        )
    share = energy_share(measured, harmonics_in(mesh_frequency, 0.0, 0.99 * measured.nyquist))
    return float(np.sqrt(share)), share


def bound_of_mesh_lines(
    measured: Signal, mesh_frequency: float, band: tuple[float, float] | None = None, max_lag: float | None = None
) -> tuple[float, float]:
    """Return `upper_bound` of the part of a measurement that `similarity` compares with the same arguments."""
    reach = _longest_lag(measured, 0.5 / mesh_frequency if max_lag is None else max_lag)
    compared = measured.with_values(measured.values[reach:-reach])
    return upper_bound(compared, mesh_frequency, band or (0.0, 0.999 * measured.nyquist))


@dataclass(frozen=True, kw_only=True)
class Similarity:
    """A cosine similarity and everything that it depends on.

    Parameters
    ----------
    value : float
        −1 to 1.
    lag : float, s
        measured(t) was compared with virtual(t + lag).
    rule : str
        How the lag was chosen, one of :data:`LAG_RULES`.
    max_lag : float, s
        The search range to both sides.
    as_they_stand : float
        The cosine without any lag.
    lowest : float
        The lowest cosine over the search range.
    share_above : float
        Share of all lags in the range that give more than 0.6, the paper's limit for a "satisfactory consistency".
    speed_ratio : float
        Mesh frequency of the measurement over that of the model before they were matched.
    bound, mesh_share : float
        The highest value that mesh lines alone can reach, and the measured signal's energy share at them; NaN if the
        mesh frequency was not given.
    """

    value: float
    lag: float
    rule: str
    max_lag: float
    as_they_stand: float
    lowest: float
    share_above: float
    speed_ratio: float
    bound: float
    mesh_share: float

    def __float__(self) -> float:
        return self.value

    def __repr__(self) -> str:
        return f"Similarity({self.describe()})"

    def describe(self) -> str:
        """The value with its lag rule, speed match and upper bound, in a line."""
        text = (
            f"{self.value:.4f}, lag {1e3 * self.lag:+.4f} ms (rule '{self.rule}', within ±{1e3 * self.max_lag:.3g} ms)"
        )
        text += f", speed ratio {self.speed_ratio:.6f}"
        if np.isfinite(self.bound):
            text += f", upper bound for mesh lines {self.bound:.4f} ({100 * self.mesh_share:.1f} % of the energy)"
        return text

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, for JSON."""
        content: dict[str, Any] = {k: getattr(self, k) for k in self.__dataclass_fields__}
        return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in content.items()}


def similarity(
    measured: Signal,
    virtual: Signal,
    *,
    mesh_frequency: float | None = None,
    virtual_mesh_frequency: float | None = None,
    band: tuple[float, float] | None = None,
    rule: LagRule = "best",
    lag: float | None = None,
    max_lag: float | None = None,
    bound: tuple[float, float] | None = None,
) -> Similarity:
    """Compare two processed signals by cosine similarity (Eq. 8).

    Parameters
    ----------
    measured, virtual : Signal
        After the same :class:`gearbox.signals.signal.Processing`.
    mesh_frequency : float, optional, Hz
        Of the measurement.
    virtual_mesh_frequency : float, optional, Hz
        Of the model; where it differs, the model's signal is stretched in time first.
    band : (float, float), optional, Hz
        Band of the processing, for the upper bound; by default up to the Nyquist frequency.
    rule : {"best", "mesh", "held", "none"}
        How the lag is chosen, see :data:`LAG_RULES`.
    lag : float, optional, s
        For the rule "held".
    max_lag : float, optional, s
        Search range to both sides; by default half a mesh period, within which a signal that repeats with the mesh
        shows all its cosines.  A longer range lets noise choose among more lags.
    bound : (float, float), optional
        What :func:`bound_of_mesh_lines` gave for the same measurement before, to spare its computation.

    Returns
    -------
    Similarity

    Raises
    ------
    SignalError
        If lengths or rates differ, a signal does not vary, or the rule lacks what it needs.
    """
    _checked(measured, virtual)
    if rule not in LAG_RULES:
        raise SignalError(f"there is no lag rule '{rule}': take one of {', '.join(LAG_RULES)}")
    if rule in ("mesh",) and mesh_frequency is None:
        raise SignalError("the lag rule 'mesh' needs the mesh frequency")
    if rule == "held" and lag is None:
        raise SignalError("the lag rule 'held' needs a lag, such as that of the model before updating")
    if max_lag is None:
        if mesh_frequency is None:
            raise SignalError("give max_lag, or the mesh frequency, of which half a period is the default range")
        max_lag = 0.5 / mesh_frequency
    ratio = 1.0
    if mesh_frequency is not None and virtual_mesh_frequency is not None:
        ratio = mesh_frequency / virtual_mesh_frequency
        virtual = match_speed(virtual, virtual_mesh_frequency, mesh_frequency)
    lags, cosines = cosine_over_lags(measured, virtual, max_lag)
    as_they_stand = cosine(measured, virtual)
    if rule == "none":
        chosen, value = 0.0, as_they_stand
    elif rule == "best":
        chosen, value = _peak(lags, cosines)
    else:
        if rule == "mesh":
            assert mesh_frequency is not None
            lag = _mesh_lag(measured, virtual, mesh_frequency, band)
        assert lag is not None
        chosen = float(lag)
        value = _cosine_at(measured, virtual, chosen, _longest_lag(measured, max(abs(chosen), max_lag)))
    if bound is None and mesh_frequency is not None:
        bound = bound_of_mesh_lines(measured, mesh_frequency, band, max_lag)
    highest, share = bound or (float("nan"), float("nan"))
    above = float(np.mean(cosines > 0.6))
    return Similarity(
        value=value,
        lag=chosen,
        rule=rule,
        max_lag=max_lag,
        as_they_stand=as_they_stand,
        lowest=float(cosines.min()),
        share_above=above,
        speed_ratio=ratio,
        bound=highest,
        mesh_share=share,
    )


def _mesh_lag(measured: Signal, virtual: Signal, mesh: float, band: Sequence[float] | None) -> float:
    """Lag that gives the first mesh line in the band the same phase in both signals, within half its period."""
    from gearbox.signals.mesh_lines import fit_lines

    low, high = band or (0.0, 0.999 * measured.nyquist)
    line = harmonics_in(mesh, low, high)[:1]
    if not line.size:
        raise SignalError(f"no mesh line lies in the band {low:g} to {high:g} Hz: widen the band")
    turn = fit_lines(measured, line).amplitudes[0] / fit_lines(virtual, line).amplitudes[0]
    return float(np.angle(turn) / (2.0 * np.pi * line[0]))
