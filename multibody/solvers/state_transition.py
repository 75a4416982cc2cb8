"""State-transition matrices of the variational equation between the samples of a trajectory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from multibody.base.parallel import parallel_map
from multibody.solvers.frozen import frozen_state_transition
from multibody.solvers.kernels.state_transition import WIDTH, integrate_intervals
from multibody.solvers.problem import ProblemError
from multibody.solvers.spectral_radius import spectral_radius

__all__ = ["Jacobians", "StateTransitionMatrices", "jacobian_times", "state_transition_matrices"]

Jacobians = Callable[[np.ndarray], Callable[[slice], tuple[np.ndarray, np.ndarray]]]
"""Of times (nt,) in any order a function that gives A (k, n, n) and B (k, n, m) at a slice of them."""

CHUNK = 128  # intervals whose Jacobians are in memory at a time, in each thread
NODES = 0.5 + np.sqrt(0.15) * np.array([-1.0, 0.0, 1.0])  # Gauss's, of order 6: where a piece's Jacobians are taken
REACH = 2.0  # step times the largest eigenvalue's magnitude
EXACT = 1e-7  # share of the fastest motion that the rest of a series may be
PARABOLA = 1e-5  # what a Jacobian times the length of its piece may be off, by a parabola through three of them
OFF = 0.024  # largest error of a parabola through the nodes, in differences of its bend to the next interval's
STIFF = 35.0  # an interval's length times its largest eigenvalue, from which matrix exponentials are cheaper
PIECES = 4  # of a stiff interval, each with a Jacobian of its own
FEWEST, MOST = 4, 20  # terms: as many as the order needs, and never more
SOME = 8  # one of as many pieces has its eigenvalues worked out, and so has every Jacobian that is not like its own
LIKE = 0.1  # share of its norm by which another Jacobian may differ and be like it; 0.03 and 0.01 gain nothing


@dataclass(frozen=True, eq=False)
class StateTransitionMatrices:
    """x_{k+1} as a linear function of x_k and of additional inputs, around a trajectory.

    A deviation δ of the state and additions φ to m inputs, linear between the samples, go on as
    δ_{k+1} = phi[k] δ_k + gamma0[k] φ_k + gamma1[k] φ_{k+1}.

    Parameters
    ----------
    phi : ndarray, shape (N - 1, n, n)
    gamma0, gamma1 : ndarray, shape (N - 1, n, m)
        Of additions that stay what they are gamma1 is zero.
    """

    phi: np.ndarray
    gamma0: np.ndarray
    gamma1: np.ndarray

    def __iter__(self):  # type: ignore[no-untyped-def]
        return iter((self.phi, self.gamma0, self.gamma1))


def state_transition_matrices(
    times: np.ndarray,
    jacobians: Jacobians,
    longest: float | np.ndarray = np.inf,
    breaks: np.ndarray | tuple[()] = (),
    lasting: int = 0,
) -> StateTransitionMatrices:
    """Return the state-transition matrices of δ' = A(t) δ + B(t) φ(t).

    The Jacobians are evaluated at three places of every interval.  Where their parabola bends otherwise than in the
    neighbouring intervals they are evaluated again, in as many pieces as there are steps at most.  A step is a
    commutator-free exponential of order 4; in stiff intervals the Jacobians are frozen piece by piece
    (`multibody.solvers.frozen`).  The global interpreter lock is released meanwhile.

    Parameters
    ----------
    times : ndarray, shape (N,), s
        Increasing.
    jacobians : callable
        ``jacobians(at)`` of times, in any order, returns a function that gives A (k, n, n) and B (k, n, m) at a slice
        of them; threads call it.
    longest : float or ndarray, shape (N - 1,), s
        Longest piece, of all intervals or of each, that jumps over no motion of the Jacobians.
    breaks : ndarray, s
        Where the Jacobians jump.
    lasting : int
        As many of the additions, the last, stay what they are: φ_{k+1} = φ_k.

    Returns
    -------
    StateTransitionMatrices
        Unpacks into phi, gamma0, gamma1.

    Raises
    ------
    ProblemError
        If the times do not fit, or a result is not finite (the message says from which sample on).

    Examples
    --------
    δ' = -t δ + φ over a second: exp(-1/2) of δ is left.

    >>> at = lambda t: lambda part: (-t[part][:, None, None], np.ones((len(t[part]), 1, 1)))
    >>> phi, gamma0, gamma1 = state_transition_matrices(np.array([0.0, 1.0]), at)
    >>> round(float(phi[0, 0, 0]), 4), round(float(np.exp(-0.5)), 4)
    (0.6065, 0.6065)
    """
    times = np.ascontiguousarray(times, dtype=np.float64)
    if times.ndim != 1 or times.size < 2 or not np.all(np.diff(times) > 0.0):
        raise ProblemError("state-transition matrices need at least two increasing times")
    h, breaks = np.diff(times), np.asarray(breaks, dtype=np.float64)
    limit = np.broadcast_to(np.asarray(longest, dtype=np.float64), h.shape)
    at = jacobians(jacobian_times(times))
    a, b = at(slice(0, 1))
    n, m = a.shape[1], b.shape[2]
    matrices = StateTransitionMatrices(*(np.zeros((h.size, n, k)) for k in (n, m, m)))
    least = np.ceil(h / limit)  # pieces
    inside = np.searchsorted(times, breaks, side="right") - 1
    within = (inside >= 0) & (inside < h.size)
    broken = np.zeros(h.size, dtype=bool)
    broken[inside[within][breaks[within] > times[inside[within]]]] = True

    def first_look(part: slice) -> tuple[np.ndarray, np.ndarray]:
        """Fill the intervals of a part whose Jacobians are smooth; return how fast all are, and in how many pieces."""
        a, b = at(slice(3 * part.start, 3 * part.stop))
        length = h[part]
        fastest, pieces = _look(a, length)
        pieces = np.minimum(pieces, np.ceil(length * fastest) + FEWEST)
        pieces = np.maximum(np.maximum(pieces, least[part]), 1.0 + broken[part])
        smooth = np.flatnonzero((pieces == 1.0) & (length * fastest <= STIFF))
        whole = np.column_stack((length, np.zeros(length.size), np.ones(length.size)))
        few, first = (3 * smooth[:, None] + np.arange(3)).ravel(), np.arange(smooth.size + 1)
        if smooth.size:
            _carry(matrices, a[few], b[few], fastest[smooth], whole[smooth], first, part.start + smooth, lasting)
        return fastest, pieces

    looks = parallel_map(first_look, _parts(h.size))
    fastest, pieces = (np.concatenate(matrix) for matrix in zip(*looks, strict=True))
    for matrix in matrices:
        matrix[~np.isfinite(fastest)] = np.nan
    stiff = np.flatnonzero((h * fastest > STIFF) & np.isfinite(fastest))
    rough = np.flatnonzero((pieces > 1.0) & (h * fastest <= STIFF))
    if stiff.size or rough.size:
        _look_again(matrices, times, jacobians, rough, pieces[rough].astype(int), stiff, breaks, lasting)
    bad = ~np.all([np.isfinite(matrix).all(axis=(1, 2)) for matrix in matrices], axis=0)
    if np.any(bad):
        raise ProblemError(
            f"the transition from t = {times[np.argmax(bad)]:.9g} s on is not finite: "
            "the state there is out of the model's range"
        )
    return matrices


def jacobian_times(times: np.ndarray) -> np.ndarray:
    """Return the times, shape (3 (N - 1),), at which `state_transition_matrices` evaluates Jacobians first."""
    return np.asarray((times[:-1, None] + np.diff(times)[:, None] * NODES).ravel())


def _parts(count: int) -> list[slice]:
    """Return slices of about `CHUNK` intervals, none of them much shorter."""
    edges = np.linspace(0, count, max(1, count // CHUNK) + 1).astype(int)
    return [slice(int(a), int(b)) for a, b in pairwise(edges)]


def _look(a: np.ndarray, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return about the largest eigenvalue of pieces from their Jacobians, and into how many each has to be split.

    Both are in units in which the rows and columns of the Jacobians are of like size.  Eigenvalues are worked out
    for some of the pieces; where the Jacobians hardly differ from these they change like the largest entry.  Where dry
    friction begins to stick one entry becomes large, and with it the eigenvalues, beside another that always is.
    """
    from scipy.linalg import matrix_balance

    most = np.max(np.abs(a), axis=0)
    if not np.all(np.isfinite(most)):
        most = np.where(np.isfinite(most), most, 1.0)
    scale = matrix_balance(most, permute=False, separate=True)[1][0]
    unit = scale / scale[:, None]

    def norm(a: np.ndarray) -> np.ndarray:
        largest: np.ndarray = np.sum(np.abs(a) * unit, axis=2).max(axis=1)
        return largest

    some = 3 * np.arange(SOME // 2, max(len(h), SOME // 2 + 1), SOME).clip(0, len(h) - 1) + 1
    nearest = some[np.minimum(np.arange(len(a)) // (3 * SOME), some.size - 1)]
    size = norm(a)
    own = np.union1d(some, np.flatnonzero(~(norm(a - a[nearest]) <= LIKE * size[nearest])))
    radius = np.zeros(len(a))
    radius[own] = spectral_radius(a[own])
    like = np.setdiff1d(np.arange(len(a)), own, assume_unique=True)
    radius[like] = radius[nearest[like]] / np.maximum(size[nearest[like]], 1e-300) * size[like]
    fastest = np.max(radius.reshape(-1, 3), axis=1)
    bend = (a[::3] - 2.0 * a[1::3] + a[2::3]) / (h * h)[:, None, None]
    changed = bend if len(h) == 1 else np.diff(bend, axis=0)
    change = np.max(np.abs(changed) * unit, axis=(1, 2))
    if len(h) > 1:
        change = np.maximum(np.append(change, 0.0), np.append(0.0, change))
    off = OFF * h**3 * change
    return fastest, np.maximum(np.ceil((np.where(np.isfinite(off), off, 0.0) / PARABOLA) ** (1.0 / 3.0)), 1.0)


def _look_again(
    matrices: StateTransitionMatrices,
    times: np.ndarray,
    jacobians: Jacobians,
    rough: np.ndarray,
    pieces: np.ndarray,
    stiff: np.ndarray,
    breaks: np.ndarray,
    lasting: int,
) -> None:
    """Fill the intervals in which the Jacobians are needed at more places: some in pieces, others frozen.

    If one piece of an interval turns out to be stiff, all its pieces are frozen, in thirds about their nodes: the
    exponentials of a step weigh the nodes with either sign, so that what dies away at one of them can grow without
    bound.
    """
    h = np.diff(times)
    owner, begin = _begins(times, rough, pieces, breaks)
    last = np.append(np.diff(owner) > 0, True)[: owner.size]
    end = np.where(last, 1.0, np.roll(begin, -1))
    length, interval = h[rough[owner]] * (end - begin), rough[owner]
    nodes = times[interval, None] + h[interval, None] * (begin[:, None] + (end - begin)[:, None] * NODES)
    middles = times[stiff, None] + h[stiff, None] * ((np.arange(PIECES) + 0.5) / PIECES)
    at = jacobians(np.concatenate((nodes.ravel(), middles.ravel())))
    first = np.searchsorted(owner, np.arange(rough.size + 1))
    spans = np.column_stack((length, begin, end))

    def keep(some: np.ndarray, phi: np.ndarray, gamma0: np.ndarray, gamma1: np.ndarray) -> None:
        of_lasting = slice(gamma0.shape[-1] - lasting, None)
        gamma0[..., of_lasting] += gamma1[..., of_lasting]
        gamma1[..., of_lasting] = 0.0
        for whole, own in zip(matrices, (phi, gamma0, gamma1), strict=True):
            whole[some] = own

    def in_pieces(part: slice) -> None:
        own = slice(int(first[part.start]), int(first[part.stop]))
        a, b = at(slice(3 * own.start, 3 * own.stop))
        fastest, _ = _look(a, length[own])
        begins = first[part.start : part.stop + 1] - own.start
        too_fast = np.maximum.reduceat(length[own] * fastest, begins[:-1]) > STIFF
        fastest[np.repeat(too_fast, np.diff(begins))] = 0.0  # filled below
        _carry(matrices, a, b, fastest, spans[own], begins, rough[part], lasting)
        for k in np.flatnonzero(too_fast):
            some, of = rough[[part.start + k]], slice(int(begins[k]), int(begins[k + 1]))
            thirds, shares = slice(3 * of.start, 3 * of.stop), np.repeat((end - begin)[own][of] / 3.0, 3)
            keep(some, *frozen_state_transition(a[None, thirds], b[None, thirds], h[some], shares))

    def frozen(part: slice) -> None:
        a, b = at(slice(nodes.size + PIECES * part.start, nodes.size + PIECES * part.stop))
        some, (n, m) = stiff[part], b.shape[1:]
        a, b = a.reshape(some.size, PIECES, n, n), b.reshape(some.size, PIECES, n, m)
        keep(some, *frozen_state_transition(a, b, h[some]))

    if rough.size:
        cuts = np.unique(np.searchsorted(first, np.arange(0, owner.size + CHUNK, CHUNK)).clip(0, rough.size))
        parallel_map(in_pieces, [slice(int(a), int(b)) for a, b in pairwise(cuts)])
    if stiff.size:
        parallel_map(frozen, _parts(stiff.size))


def _begins(
    times: np.ndarray, rough: np.ndarray, pieces: np.ndarray, breaks: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return of every piece the place of its interval in ``rough``, and which share of the interval is over before."""
    owner = np.repeat(np.arange(rough.size), pieces)
    begin = (np.arange(owner.size) - (np.cumsum(pieces) - pieces)[owner]) / pieces[owner]
    interval = np.clip(np.searchsorted(times, breaks, side="right") - 1, 0, times.size - 2)
    share = (breaks - times[interval]) / np.diff(times)[interval]
    inside = np.isin(interval, rough) & (share > 0.0) & (share < 1.0)
    owner = np.append(owner, np.searchsorted(rough, interval[inside]))
    begin = np.append(begin, share[inside])
    order = np.lexsort((begin, owner))
    owner, begin = owner[order], begin[order]
    new = np.append(True, (np.diff(owner) > 0) | (np.diff(begin) > 1e-9))[: owner.size]
    return owner[new], begin[new]


def _carry(
    matrices: StateTransitionMatrices,
    a: np.ndarray,
    b: np.ndarray,
    fastest: np.ndarray,
    spans: np.ndarray,
    first: np.ndarray,
    which: np.ndarray,
    lasting: int,
) -> None:
    """Fill some intervals from the Jacobians at the nodes of their pieces; ``spans`` to ``which`` are the driver's."""
    n, m = b.shape[1:]
    reach = np.where(np.isfinite(fastest), fastest, 0.0) * spans[:, 0]
    steps = np.maximum(np.ceil(reach / REACH), 1.0)
    counts = np.stack((steps, _terms(0.5 * reach / steps)), axis=1).astype(np.int64, order="C")
    begin, columns, where = _pattern(np.any(a != 0.0, axis=0))
    row_of, column_of = (np.ascontiguousarray(k) for k in np.nonzero(np.any(b != 0.0, axis=0)))
    integrate_intervals(
        a.reshape(len(a), n * n),
        np.ascontiguousarray(b).reshape(len(b), n * m),
        begin,
        columns,
        where,
        row_of,
        column_of,
        np.where(column_of < m - lasting, column_of + m, column_of),
        row_of * m + column_of,
        np.ascontiguousarray(first, dtype=np.int64),
        np.ascontiguousarray(spans),
        counts,
        np.ascontiguousarray(which, dtype=np.int64),
        np.zeros(3 * n * WIDTH + where.size + row_of.size),
        *matrices,
    )


def _terms(z: np.ndarray) -> np.ndarray:
    """Return how many terms the series of exp(z) needs beside its first."""
    rest, terms = np.ones(z.size), np.full(z.size, float(FEWEST))
    for k in range(1, MOST + 1):
        rest = rest * z / k
        terms[(rest > EXACT) & (k > FEWEST)] = k
    return terms


def _pattern(filled: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where each row begins, of its entries the columns, and their places in the matrix.

    Rows are filled up to four entries or a multiple of that: those that are none have the place -1.
    """
    begin, columns, where = np.zeros(len(filled) + 1, dtype=np.int64), [], []
    for i, row in enumerate(filled):
        own = np.flatnonzero(row)
        none = -own.size % 4 if own.size else 4
        columns += [own, np.zeros(none, dtype=np.int64)]
        where += [own + i * row.size, np.full(none, -1)]
        begin[i + 1] = begin[i] + own.size + none
    return begin, np.concatenate(columns), np.concatenate(where)
