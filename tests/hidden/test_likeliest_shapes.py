"""The place about which a spring bends is where the likelihood puts it: least squares takes a random force for bending.

A carriage on a spring that hardens about a place 4 mm beside its rest, pushed by a recorded force and by a wind that
nobody recorded.
"""

from __future__ import annotations

import numpy as np
from plain_machines import CARRIAGE, CARRIAGE_STUDY, RECORDS, carriage_record, written

from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.innovations.noise_model import NoiseModel, Process
from discrepancy.study.study import Study

CENTRE, STIFFNESS = 4e-3, 6e3


def carriage(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return one record of the machine, under a wind of 4 N."""
    return carriage_record(rng, 4.0, 1.0, lambda x, wind: wind - STIFFNESS * (x - CENTRE) ** 3)


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
