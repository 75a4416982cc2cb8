"""Observability of a machine along a run: rank, Gramian, detectability, and whether covariances stay bounded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from estimation.filters.errors import FilterError
from estimation.filters.run import FilterRun

if TYPE_CHECKING:
    import pandas

__all__ = ["Observability", "observability"]

_RANK = 1e-9
_UNDAMPED = 1e-6


@dataclass(frozen=True)
class Undetectable:
    """A motion that no reading shows and that does not decay by itself.

    Parameters
    ----------
    growth : float, 1/s
        Real part of its exponent; zero for one that stays.
    frequency : float, Hz
    states : tuple of (str, float)
        States that take part, with their share of the motion in units of their scale, largest first.
    """

    growth: float
    frequency: float
    states: tuple[tuple[str, float], ...]

    def __str__(self) -> str:
        parts = ", ".join(f"{share:+.2f} {name}" for name, share in self.states)
        return f"{parts} (exponent {self.growth:.3g} 1/s, {self.frequency:.3g} Hz)"


@dataclass(frozen=True, eq=False, kw_only=True)
class Observability:
    """Which states the readings of a run determine.

    Parameters
    ----------
    names : tuple of str
    rank : int
        Of the Gramian over the window with most information; the number of states if all are observable.
    information : ndarray, shape (n,)
        Square roots of the eigenvalues of the scaled Gramian, largest first: how many standard deviations of the
        readings one scale of each direction is worth.
    weakest : tuple of (str, float)
        States of the least observable direction.
    undetectable : tuple of Undetectable
        At all instants examined; empty if the machine is detectable.
    instants, detectable_instants : int
        Instants examined, and those of them where nothing is undetectable.
    std : dict of str to (float, float)
        Standard deviation of each state: largest in the middle third of the run, and in the last.
    """

    names: tuple[str, ...]
    rank: int
    information: np.ndarray
    weakest: tuple[tuple[str, float], ...]
    undetectable: tuple[Undetectable, ...]
    instants: int
    detectable_instants: int
    std: dict[str, tuple[float, float]] = field(repr=False)

    @property
    def detectable(self) -> bool:
        """True if every motion that no reading shows decays by itself, at every instant examined."""
        return self.detectable_instants == self.instants

    def bounded(self, name: str, slack: float = 0.1) -> bool:
        """Return whether a state's standard deviation grows by no more than ``slack`` in the last third of the run."""
        middle, last = self.std[name]
        return last <= (1.0 + slack) * middle

    def to_frame(self) -> pandas.DataFrame:
        """Return the standard deviations and whether they are bounded, by state."""
        import pandas

        rows = {
            n: {"std, middle third": a, "std, last third": b, "bounded": self.bounded(n)}
            for n, (a, b) in self.std.items()
        }
        return pandas.DataFrame.from_dict(rows, orient="index")

    def sentences(self) -> list[str]:
        """Return the result in sentences."""
        sentences = [f"the readings determine {self.rank} of {len(self.names)} states over a window"]
        if self.detectable:
            sentences.append("every motion that they do not show decays by itself: the machine is detectable")
        else:
            motions = "; ".join(str(motion) for motion in self.undetectable[:3])
            sentences.append(
                f"at {self.instants - self.detectable_instants} of {self.instants} instants a motion is neither shown "
                f"nor decays: {motions}"
            )
        return sentences


def _share(direction: np.ndarray, names: Sequence[str], least: float = 0.1) -> tuple[tuple[str, float], ...]:
    v = np.real(direction * np.exp(-1j * np.angle(direction[np.argmax(np.abs(direction))])))
    v = v / np.linalg.norm(v)
    order = np.argsort(-np.abs(v))
    return tuple((names[i], float(v[i])) for i in order if abs(v[i]) >= least)


def undetectable_modes(
    transition: np.ndarray, rows: np.ndarray, step: float, names: Sequence[str], tolerance: float = _UNDAMPED
) -> list[Undetectable]:
    """Return the motions of one instant's linearisation that are not shown and do not decay.

    By the test of Popov, Belevitch and Hautus: an exponent whose real part is not negative, with a direction
    that the rows do not see.

    Parameters
    ----------
    transition : ndarray, shape (n, n)
        Scaled so that its states are comparable.
    rows : ndarray, shape (m, n)
        Scaled likewise, over the standard deviation of the readings.
    step : float, s
    """
    values = np.linalg.eigvals(transition)
    modes: list[Undetectable] = []
    done: list[complex] = []
    for value in values:
        exponent = np.log(value + 0j) / step if value != 0 else -np.inf
        if exponent.real < -tolerance / step or value.imag < -1e-12:
            continue
        if any(abs(value - other) < 1e-7 for other in done):
            continue
        done.append(value)
        stack = np.vstack([(transition - value * np.eye(len(transition))) / step, rows])
        _, sizes, right = np.linalg.svd(stack)
        for k in np.flatnonzero(sizes < _RANK * sizes[0]):
            modes.append(
                Undetectable(
                    float(exponent.real), float(abs(exponent.imag) / (2 * np.pi)), _share(right[k].conj(), names)
                )
            )
    return modes


def gramian(transitions: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return Σ Φᵀ Hᵀ H Φ over a window: the information of scaled readings about the state at its beginning.

    Parameters
    ----------
    transitions : ndarray, shape (k, n, n)
        The first is not used.
    rows : ndarray, shape (k, m, n)
        Over the standard deviation of the readings.
    """
    n = transitions.shape[1]
    reach, total = np.eye(n), np.zeros((n, n))
    for k in range(len(transitions)):
        if k > 0:
            reach = transitions[k] @ reach
        seen = rows[k] @ reach
        total += seen.T @ seen
    return 0.5 * (total + total.T)


def observability(
    run: FilterRun, *, scale: np.ndarray | None = None, window: int = 500, instants: int = 60, part: slice | None = None
) -> Observability:
    """Examine which states the readings of a run determine, along its own linearisations.

    Parameters
    ----------
    run : FilterRun
        With everything kept.
    scale : ndarray, shape (n,), optional
        Size of each state that matters; default: its mean standard deviation in the prediction.
    window : int
        Samples of a Gramian.
    instants : int
        Number of linearisations that are tested for detectability, spread over the run.
    part : slice, optional
        Rows of the run to examine, such as those where the machine moves; default: all.
    """
    if "transitions" not in run.kept:
        raise FilterError(
            "observability",
            ['the filter did not keep its transitions: run extended_kalman_filter(…, keep="everything")'],
        )
    names = run.model.state_names
    rows_of = np.arange(len(run.times))[part if part is not None else slice(None)]
    predicted = np.diagonal(run.kept["predicted"][rows_of], axis1=1, axis2=2)
    if scale is None:
        scale = np.sqrt(np.maximum(predicted[len(predicted) // 10 :].mean(axis=0), 0.0))
    scale = np.where(scale > 0.0, scale, 1.0)
    _, r = run.noise.of(run.model)
    transitions = run.kept["transitions"] * scale[None, None, :] / scale[None, :, None]
    rows = run.kept["rows"] * scale[None, None, :] / np.sqrt(r)[None, :, None]
    rows = np.where(np.isfinite(run.innovations)[:, :, None], rows, 0.0)
    seen = np.flatnonzero(np.isfinite(run.innovations).all(axis=1))
    seen = seen[(seen > 0) & np.isin(seen, rows_of)]
    if seen.size == 0:
        raise FilterError("observability", ["no instant has all readings: resample the channels to one rate"])
    chosen = np.unique(seen[np.linspace(0, seen.size - 1, instants).astype(int)])
    undetectable: list[Undetectable] = []
    detectable_instants = 0
    for k in chosen:
        step = float(run.times[k] - run.times[k - 1])
        modes = undetectable_modes(transitions[k], rows[k], step, names)
        detectable_instants += not modes
        undetectable += [m for m in modes if m not in undetectable]
    best = np.zeros(len(names))
    direction = np.eye(len(names))[0]
    for begin in range(0, max(len(rows_of) - window, 0) + 1, max(window, 1)):
        chunk = rows_of[begin : begin + window]
        values, vectors = np.linalg.eigh(gramian(transitions[chunk], rows[chunk]))
        if np.count_nonzero(values > _RANK * values[-1]) >= np.count_nonzero(best > _RANK * best.max(initial=0.0)):
            best, direction = values, vectors[:, 0]
    third = max(len(rows_of) // 3, 1)
    deviation = np.sqrt(np.maximum(run.variances[rows_of], 0.0))
    std = {
        name: (float(deviation[third : 2 * third, j].max(initial=0.0)), float(deviation[2 * third :, j].max()))
        for j, name in enumerate(names)
    }
    return Observability(
        names=names,
        rank=int(np.count_nonzero(best > _RANK * best.max())),
        information=np.sqrt(np.maximum(best[::-1], 0.0)),
        weakest=_share(direction, names),
        undetectable=tuple(undetectable),
        instants=len(chosen),
        detectable_instants=detectable_instants,
        std=std,
    )
