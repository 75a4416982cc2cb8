"""A machine linearised along one record, from one prepared sample to the next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimation.response.experiment import Experiment
from estimation.response.perturbations import Channel, PerturbationResponse, StateRate
from multibody.machine.model import System
from multibody.solvers.kernels.perturbations import propagate

__all__ = ["LinearRecord", "linear_record"]


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearRecord:
    """State-transition matrices between the prepared samples of a record.

    A deviation δ of the state and additions φ to m inputs, linear between the samples, go on as
    δ_{k+1} = phi[k] δ_k + gamma0[k] φ_k + gamma1[k] φ_{k+1}; the outputs deviate by c[k] δ_k + d[k] φ_k.

    Parameters
    ----------
    time : ndarray, shape (N,), s
        Begins where the record begins.
    observed : ndarray of bool, shape (N,)
        Which samples are measured and prepared.
    phi : ndarray, shape (N - 1, n, n)
    gamma0, gamma1 : ndarray, shape (N - 1, n, m)
    c, d : ndarray, shape (N, n_c, n) and (N, n_c, m)
    left_out : ndarray of bool, shape (N,)
        Which samples are no part of the likelihood although they are measured.
    """

    time: np.ndarray
    observed: np.ndarray
    phi: np.ndarray
    gamma0: np.ndarray
    gamma1: np.ndarray
    c: np.ndarray
    d: np.ndarray
    left_out: np.ndarray

    @property
    def counts(self) -> np.ndarray:
        """Which samples are part of the likelihood, shape (N,)."""
        return self.observed & ~self.left_out

    @property
    def used(self) -> np.ndarray:
        """Which of the measured samples are part of the likelihood, shape (n,)."""
        used: np.ndarray = ~self.left_out[self.observed]
        return used

    def without(self, left_out: np.ndarray) -> LinearRecord:
        """Return the same with some of the measured samples, shape (n,) of bool, left out of the likelihood."""
        whole = np.zeros(self.time.size, dtype=bool)
        whole[self.observed] = left_out
        return replace(self, left_out=whole)

    def response(self, values: np.ndarray, inputs: np.ndarray | None = None) -> np.ndarray:
        """Return how additions to inputs change the outputs, each by itself, shape (N, n_c, k).

        Parameters
        ----------
        values : ndarray, shape (N, k)
        inputs : ndarray of int, shape (k,), optional
            Column of the input that each is added to; default: all inputs in their order.
        """
        k = values.shape[1]
        columns = np.arange(k) if inputs is None else inputs
        changed, room = np.zeros((*self.c.shape[:2], k)), np.zeros((2, self.phi.shape[1], k))
        matrices = (self.phi, self.gamma0, self.gamma1, self.c, self.d)
        propagate(*matrices, columns, np.ascontiguousarray(values), room, changed)
        return changed

    def with_modulated(self, columns: Sequence[int], weights: Sequence[np.ndarray]) -> LinearRecord:
        """Return the same with further inputs: copies of some, each times a weight over the time, shape (N,)."""
        if not columns:
            return self
        w = np.stack([np.asarray(weight, dtype=float) for weight in weights], axis=1)
        chosen = list(columns)

        def more(block: np.ndarray, weight: np.ndarray) -> np.ndarray:
            return np.ascontiguousarray(np.concatenate([block, block[:, :, chosen] * weight[:, None, :]], axis=2))

        return replace(self, gamma0=more(self.gamma0, w[:-1]), gamma1=more(self.gamma1, w[1:]), d=more(self.d, w))

    def every(self, count: int) -> LinearRecord:
        """Return the same on every so-manieth sample, for estimates that need no more."""
        keep = np.arange(0, self.time.size, count)
        phi, gamma0, gamma1 = _composed(self.time, keep, self.phi, self.gamma0, self.gamma1)
        return LinearRecord(
            time=self.time[keep],
            observed=self.observed[keep],
            phi=phi,
            gamma0=gamma0,
            gamma1=gamma1,
            c=self.c[keep],
            d=self.d[keep],
            left_out=self.left_out[keep],
        )


def linear_record(
    experiment: Experiment,
    system: System,
    p: np.ndarray,
    x0: np.ndarray,
    channels: Sequence[str],
    rates: Sequence[str] = (),
) -> LinearRecord:
    """Return the linearisation along a record with additions to some inputs, and to the rates of some states.

    States that no output depends on are left out.

    Parameters
    ----------
    experiment : Experiment
    system : System
        With these inputs.
    p : ndarray, shape (n_p,)
    x0 : ndarray, shape (n_x,)
    channels : sequence of str
        Inputs that the latent forces are added to.
    rates : sequence of str
        States to whose rates something is added as well; these columns follow those of the inputs.

    Raises
    ------
    SimulationError
        If the machine cannot be simulated along the record.
    """
    if not len(system.states):
        return _without_states(experiment, system, p, channels)
    acting: tuple[Channel, ...] = (*channels, *map(StateRate, rates))
    response = PerturbationResponse.along(experiment.simulation(system, p, x0), acting)
    raw = np.array(experiment.record.time)
    prepared = experiment.time
    keep = _kept(raw, prepared)
    seen = _states_that_matter(response)
    phi = response.phi[:, seen][:, :, seen]
    composed = _composed(raw, keep, phi, response.gamma0[:, seen], response.gamma1[:, seen])
    observed = np.ones(keep.size, dtype=bool)
    observed[: keep.size - prepared.size] = False
    return LinearRecord(
        time=raw[keep],
        observed=observed,
        phi=composed[0],
        gamma0=composed[1],
        gamma1=composed[2],
        c=np.ascontiguousarray(response.c[keep][:, :, seen]),
        d=np.ascontiguousarray(response.d[keep]),
        left_out=np.zeros(keep.size, dtype=bool),
    )


def _kept(raw: np.ndarray, prepared: np.ndarray) -> np.ndarray:
    """Return which samples stand for the prepared ones, and the first; a mean stands for its middle sample."""
    step = float(np.median(np.diff(raw)))
    nearest = np.searchsorted(raw, prepared - 0.5 * step - 1e-9 * step)
    return np.unique(np.concatenate([[0], nearest]))


def _without_states(experiment: Experiment, system: System, p: np.ndarray, channels: Sequence[str]) -> LinearRecord:
    """Return the linearisation of a machine whose motion is given: inputs act on the outputs at once.

    It has one state that does nothing, because the recursions need one.
    """
    raw = np.array(experiment.record.time)
    prepared = experiment.time
    keep = _kept(raw, prepared)
    inputs = np.ascontiguousarray(np.reshape(experiment.table(system)(raw, p), (raw.size, -1)))
    columns = np.array([system.index("input", c) for c in channels], dtype=int)
    rows = np.array([system.index("output", n) for n in experiment.outputs])
    d = system.jacobian_along("u", raw, np.zeros((raw.size, 0)), inputs, p, of="outputs", columns=columns)
    observed = np.ones(keep.size, dtype=bool)
    observed[: keep.size - prepared.size] = False
    count, m = keep.size, len(channels)
    return LinearRecord(
        time=raw[keep],
        observed=observed,
        phi=np.zeros((count - 1, 1, 1)),
        gamma0=np.zeros((count - 1, 1, m)),
        gamma1=np.zeros((count - 1, 1, m)),
        c=np.zeros((count, rows.size, 1)),
        d=np.ascontiguousarray(d[keep][:, rows]),
        left_out=np.zeros(count, dtype=bool),
    )


def _states_that_matter(response: PerturbationResponse) -> np.ndarray:
    """Return which states some output depends on, now or later, shape (n,) of bool."""
    depends = np.any(response.phi != 0.0, axis=0)
    seen = np.any(response.c != 0.0, axis=(0, 1))
    while True:
        more = seen | np.any(depends[seen], axis=0)
        if np.array_equal(more, seen):
            return more
        seen = more


def _composed(
    time: np.ndarray, keep: np.ndarray, phi: np.ndarray, gamma0: np.ndarray, gamma1: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the transitions between kept samples; additions are linear between these."""
    steps = np.diff(keep)
    if np.all(steps == 1):
        part = slice(int(keep[0]), int(keep[-1]))
        return tuple(np.ascontiguousarray(a[part]) for a in (phi, gamma0, gamma1))  # type: ignore[return-value]
    n, m = phi.shape[1], gamma0.shape[2]
    whole = np.broadcast_to(np.eye(n), (steps.size, n, n)).copy()
    first, last = np.zeros((steps.size, n, m)), np.zeros((steps.size, n, m))
    for j in range(int(steps.max())):
        inside = np.flatnonzero(j < steps)
        at = keep[inside] + j
        length = time[keep[inside + 1]] - time[keep[inside]]
        s0, s1 = ((time[at + i] - time[keep[inside]]) / length for i in (0, 1))
        s0, s1 = s0[:, None, None], s1[:, None, None]
        whole[inside] = phi[at] @ whole[inside]
        first[inside] = phi[at] @ first[inside] + gamma0[at] * (1.0 - s0) + gamma1[at] * (1.0 - s1)
        last[inside] = phi[at] @ last[inside] + gamma0[at] * s0 + gamma1[at] * s1
    return whole, first, last
