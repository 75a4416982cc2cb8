"""A model whose error is more than noise, and large beside what the output does, is not said to be complete."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from discrepancy.conclusion.sentences import LARGE_OVER_SPREAD, MORE_THAN_NOISE, poor_fit_note


def stage_with(over_noise, over_spread):
    """Return what a stage knows of one output whose error is so many times its noise and so much of its spread."""
    measured = np.sin(np.linspace(0.0, 20.0, 500))[:, None]
    error = over_spread * float(np.std(measured))
    fit = SimpleNamespace(experiment=SimpleNamespace(measured=measured))
    return SimpleNamespace(
        outputs=("speed",),
        noise={"speed": error / over_noise},
        rmse=lambda records: {"speed": error},
        identify=SimpleNamespace(fits=(fit,)),
    )


@pytest.mark.parametrize(
    ("over_noise", "over_spread", "said"),
    [
        (1.5 * MORE_THAN_NOISE, 2.0 * LARGE_OVER_SPREAD, True),
        (0.5 * MORE_THAN_NOISE, 2.0 * LARGE_OVER_SPREAD, False),
        (1.5 * MORE_THAN_NOISE, 0.2 * LARGE_OVER_SPREAD, False),
    ],
)
def test_both_have_to_be_exceeded(over_noise, over_spread, said):
    assert bool(poor_fit_note(stage_with(over_noise, over_spread), "nothing missing")) is said
