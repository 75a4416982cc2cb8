"""A record with fewer states has the same outputs and the same likelihood."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from discrepancy.innovations.fewer_states import TOLERANCE, with_fewer_states
from discrepancy.innovations.linear_record import LinearRecord
from discrepancy.innovations.noise_fit import RecordColumns, restricted_log_likelihood
from discrepancy.innovations.noise_model import NoiseModel, Process

STEP, COUNT = 0.02, 300
NOISE = np.array([1e-4, 1e-2])


def chain(masses: int, stiffness: float, *, free: bool = False) -> LinearRecord:
    """Return a chain of masses; forces act on the first and the third, the last one's position and speed are measured.

    Half-way the dampers between the masses become ten times as strong.
    """
    pull = 2.0 * np.eye(masses) - np.eye(masses, k=1) - np.eye(masses, k=-1)
    pull[-1, -1] = 1.0
    if free:
        pull[0, 0] = 1.0

    def transitions(damping: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        n = 2 * masses
        a = np.zeros((n + 4, n + 4))  # state, forces, and their rates between two samples
        a[:masses, masses:n] = np.eye(masses)
        a[masses:n, :masses], a[masses:n, masses:n] = -stiffness * pull, -damping * pull - 0.3 * np.eye(masses)
        a[masses, n] = a[masses + 2, n + 1] = 1.0
        a[n, n + 2] = a[n + 1, n + 3] = 1.0
        whole = expm(a * STEP)
        ramp = whole[:n, n + 2 :] / STEP
        return whole[:n, :n], whole[:n, n : n + 2] - ramp, ramp

    parts = [transitions(20.0), transitions(200.0)]
    half = (COUNT - 1) // 2
    phi, gamma0, gamma1 = (
        np.concatenate([np.repeat(parts[0][k][None], half, axis=0), np.repeat(parts[1][k][None], COUNT - 1 - half, 0)])
        for k in range(3)
    )
    c = np.zeros((COUNT, 2, 2 * masses))
    c[:, 0, masses - 1] = c[:, 1, 2 * masses - 1] = 1.0
    return LinearRecord(
        time=STEP * np.arange(COUNT),
        observed=np.ones(COUNT, dtype=bool),
        phi=np.ascontiguousarray(phi),
        gamma0=np.ascontiguousarray(gamma0),
        gamma1=np.ascontiguousarray(gamma1),
        c=c,
        d=np.zeros((COUNT, 2, 2)),
        left_out=np.zeros(COUNT, dtype=bool),
    )


@pytest.mark.parametrize("free", [False, True])
def test_a_stiff_chain_needs_few_states(free: bool) -> None:
    whole = chain(12, 1e6, free=free)
    fewer = with_fewer_states(whole, NOISE)
    assert fewer.phi.shape[1] <= 12  # of 24
    t = whole.time
    forces = np.stack([np.sin(3.0 * t) + 0.2, np.sign(np.sin(2.0 * t))], axis=1)  # not those that it was chosen by
    one, other = (record.response(forces) / NOISE[:, None] for record in (whole, fewer))
    error, size = (np.max(np.sqrt(np.mean(y**2, axis=0)), axis=0) for y in (other - one, one))  # of each force
    assert np.all(error < 2.0 * TOLERANCE * size)  # other forces than those, with another spectrum


def test_the_likelihood_is_the_same() -> None:
    whole = chain(12, 2e4)
    fewer = with_fewer_states(whole, NOISE)
    rng = np.random.default_rng(3)
    force = np.cumsum(rng.standard_normal((COUNT, 2)), axis=0)
    residual = np.sum(whole.response(force), axis=2) + NOISE * rng.standard_normal((COUNT, 2))
    none = np.zeros((COUNT, 2, 0))
    model = NoiseModel(
        noise=tuple(NOISE.tolist()),
        processes=tuple(Process(where="", source=j, channel=-1, memory=2.0, std=5.0) for j in range(2)),
    )
    values = [
        restricted_log_likelihood(
            [RecordColumns(record=record, residual=residual, shared=none, own=none, spread=np.ones(2))],
            model,
            np.zeros(0),
            np.zeros(0),
        )
        for record in (whole, fewer)
    ]
    assert values[1] == pytest.approx(values[0], abs=1.0)  # nats: a third of what one model must be better by


def test_a_machine_of_which_every_state_is_seen_stays_whole() -> None:
    whole = chain(3, 4.0)
    assert with_fewer_states(whole, NOISE) is whole
