"""The place about which a spring bends is where the likelihood puts it: least squares takes a random force for bending.

A carriage on a spring that hardens about a place 4 mm beside its rest, pushed by a recorded force and by a wind that
nobody recorded.
"""

from __future__ import annotations

import numpy as np
from plain_machines import CARRIAGE, CARRIAGE_STUDY, RECORDS, low_passed, written
from scipy.integrate import solve_ivp

from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.innovations.noise_model import NoiseModel, Process
from discrepancy.study.study import Study

CENTRE, STIFFNESS = 4e-3, 6e3


def carriage(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return one record of the machine: 20 s at 50 Hz, with a wind of 4 N."""
    t = np.arange(0.0, 20.0, 0.02)
    force = 20.0 * np.sin(2.0 * np.pi * t / 4.0 + rng.uniform(0.0, 6.0)) + 10.0 * low_passed(rng, t, 1.0)
    wind = 4.0 * low_passed(rng, t, 1.0)

    def rates(now, y):
        x, v = y
        return [v, (np.interp(now, t, force + wind) - STIFFNESS * (x - CENTRE) ** 3 - 210.0 * x - 7.5 * v) / 2.05]

    y = solve_ivp(rates, (0.0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-8, atol=1e-10, max_step=0.02).y
    return {
        "time_s": t,
        "force_N": force,
        "position_m": y[0] + 2e-4 * rng.standard_normal(t.size),
        "velocity_m_s": y[1] + 2e-3 * rng.standard_normal(t.size),
    }


def test_the_likeliest_centre_is_nearer_than_that_of_least_squares(tmp_path) -> None:
    """In the mean square; the noise model is that of the wind."""
    wind = Process(where="spring", source=0, channel=-1, memory=1.0, std=4.0)
    noise = NoiseModel(noise=(2e-4, 2e-3), processes=(wind,))
    squares, likeliest = [], []
    for seed in (51, 52, 53, 54):
        folder = tmp_path / str(seed)
        folder.mkdir()
        study = Study.from_file(written(folder, CARRIAGE, carriage, CARRIAGE_STUDY + RECORDS, seed=seed))
        likelihood = StageLikelihood(stage=study.add("cubic_stiffness@spring"), start=noise, grow=False)
        (effect,) = likelihood.stage.effects
        name = effect.parameter_name("centre")
        assert name in likelihood.held
        fitted = likelihood.stage.identify.to_dict()[name]
        assert likelihood.likeliest_values()[name] == fitted
        squares.append((fitted - CENTRE) ** 2)
        likeliest.append((likelihood.likeliest_values(shapes=True)[name] - CENTRE) ** 2)
    assert np.mean(likeliest) < np.mean(squares), (squares, likeliest)
