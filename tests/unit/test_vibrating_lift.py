"""The vibrating virtual lift: what each cause does to the rail's force, the recordings and the parameters."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from vtsdt.papers.vibration import CAUSES, Cause
from vtsdt.rig.one_dimensional import PlainLiftRig
from vtsdt.rig.parts import RailJoints, RailWave
from vtsdt.rig.vibration import VibratingLiftRig, broad_band


def test_waves_of_a_broad_band_have_the_size_asked_for() -> None:
    waves = broad_band(5.0, 12, 0.04, 0.4, np.random.default_rng(1))
    assert all(0.04 <= length <= 0.4 for length, _, _ in waves)
    z = np.linspace(0.0, 400.0, 200_001)
    force = sum(level * np.cos(2.0 * np.pi * z / length + phase) for length, phase, level in waves)
    assert np.std(force) == pytest.approx(5.0, rel=0.02)
    assert waves == broad_band(5.0, 12, 0.04, 0.4, np.random.default_rng(1))


def test_noise_is_on_the_recorded_reference_alone() -> None:
    noisy, plain = VibratingLiftRig(reference_noise=0.1), PlainLiftRig()
    changed = [n.signal for n, p in zip(noisy.channels, plain.channels, strict=True) if n != p]
    assert changed == ["omega_ref"]
    assert VibratingLiftRig().channels == plain.channels


def test_the_gain_is_the_rigs_and_not_the_models() -> None:
    rig = VibratingLiftRig(speed_gain=0.5)
    assert rig.true_parameters({}).control.K_pomega == pytest.approx(0.5 * rig.parameters.control.K_pomega)
    assert VibratingLiftRig().true_parameters({}).control.K_pomega == rig.parameters.control.K_pomega


def test_rails_add_their_parts_to_the_true_lift() -> None:
    from vtsdt.rig.models import build

    rig = VibratingLiftRig(waves=((0.08, 0.0, 3.0), (0.1, 1.0, 2.0)), joints=40.0)
    true_model, _ = rig._hiding(build(), (), ())
    parts = [p for p in true_model.components.values() if isinstance(p, RailWave | RailJoints)]
    assert [p.values["level"] for p in parts] == [3.0, 2.0, 40.0]


def test_each_cause_is_one_setting_of_the_rig() -> None:
    known = {f.name for f in dataclasses.fields(VibratingLiftRig)}
    for cause in CAUSES:
        assert isinstance(cause, Cause)
        assert len(cause.settings) == 1
        assert set(cause.settings) <= known
