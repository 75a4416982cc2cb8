"""Bad input to the lift: every error names part and height, or time, and says what to do."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from multibody.base.errors import SimulationError
from vtsdt.files.parameters import BENCH, LiftParameters, ParameterError, RailProfile
from vtsdt.lift.lift import Lift

BASE = LiftParameters.bench()


def replaced(section, **values):
    return dataclasses.replace(BASE, **{section: dataclasses.replace(getattr(BASE, section), **values)})


def test_rails_shorter_than_the_travel():
    message = r"rails end at 2\.2 m, but the cabin's upper shoes reach 2\.45 m"
    with pytest.raises(ParameterError, match=message) as caught:
        Lift.reference(replaced("hoistway", rail_top=2.2))
    assert "counterweight's upper shoes reach 2.4 m" in str(caught.value)  # all faults at once
    with pytest.raises(ParameterError, match=r"rails begin at 0\.1 m"):
        Lift.reference(replaced("hoistway", rail_bottom=0.1))


def test_a_profile_shorter_than_the_travel():
    short = RailProfile((-0.1, 1.0, 2.0), (0.0, 1e-3, 0.0))
    with pytest.raises(ParameterError, match=r"cabin_guide\.right_x\] ends at 2 m, but the shoes reach 2\.45 m"):
        Lift.reference(replaced("cabin_guide", right_x=short))


def test_a_clearance_larger_than_the_gap():
    with pytest.raises(ParameterError, match=r"cabin_guide\] the clearance 600 mm is not smaller than the gap of 8 mm"):
        Lift.reference(replaced("cabin_guide", clearance=0.6))


def test_a_profile_in_millimetres_taken_for_metres():
    big = RailProfile((-0.1, 1.0, 2.6), (0.0, 2.3, 0.0))
    with pytest.raises(ParameterError, match=r"deviates by 2300 mm at 1 m.*units"):
        Lift.reference(replaced("cabin_guide", right_x=big))


def test_a_rope_too_short_for_the_travel():
    with pytest.raises(ParameterError, match=r"L_0_c is 1\.5 m .*no rope is left"):
        Lift.reference(replaced("ropes", L_0_c=1.5))


def test_a_rope_used_up_during_a_trip_names_the_time():
    lift = Lift.one_dimensional()
    with pytest.raises(SimulationError, match=r"rope on the cabin's side has no length left at 5\.4\d\d s"):
        lift.trip("up", inputs={"omega_ref": -5.0, "friction_c": 0.0, "friction_cw": 0.0})  # 0.5 m/s from 0 to 2.7 m


def test_a_reference_that_leaves_the_hoistway_names_end_and_time():
    lift = Lift.reference()
    t = np.linspace(0.0, 6.0, 601)
    with pytest.raises(SimulationError, match=r"leaves the hoistway at its top \(1\.9 m\) at 4\.8\d\d s"):
        lift.trip("up", inputs={"omega_ref": (t, np.full(601, -4.0))})
    with pytest.raises(SimulationError, match="leaves the hoistway at its bottom"):
        lift.trip("up", inputs={"omega_ref": (t, np.full(601, 4.0))})


def test_a_start_outside_the_hoistway():
    with pytest.raises(ParameterError, match=r"start is 2\.5 m, outside the hoistway"):
        Lift.reference(start=2.5)


def test_inclination_without_vertical_motion():
    with pytest.raises(ParameterError, match="support_inclination needs support_vertical"):
        Lift.reference(support_vertical=False)


def test_a_direction_that_is_none():
    with pytest.raises(ValueError, match="'up' or 'down'"):
        Lift.cabin().trip("sideways")


# ---------------------------------------------------------------- files


def written(tmp_path, text):
    path = tmp_path / "lift.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_shipped_file_and_one_that_extends_it_are_read(tmp_path):
    assert LiftParameters.load(BENCH) == BASE
    mine = 'extends = "bench"\nname = "mine"\n[cabin]\nmass = "0.05 t"\n[cabin_guide]\nright_x = false\n'
    path = written(tmp_path, mine)
    mine = LiftParameters.load(path)
    assert mine.cabin.mass == pytest.approx(50.0)
    assert mine.cabin_guide.right_x is None
    assert mine.counterweight == BASE.counterweight


def test_all_faults_of_a_file_are_reported_together(tmp_path):
    path = written(
        tmp_path,
        """
extends = "bench"
[cabin]
mass = "32 m"
hicth = 0.6
com = [0.0, 0.0]
[ropes]
EA = -1.0
[brake]
torque = 3.0
[cabin_guide.right_x]
height = [0.0, 1.0, 0.5]
deviation = [0.0, 1.0, 2.0]
unit = "mm"
""",
    )
    with pytest.raises(ParameterError) as caught:
        LiftParameters.load(path)
    message = str(caught.value)
    assert "lift.toml" in message
    assert "[cabin] mass: " in message
    assert "[cabin] has no entry 'hicth'; did you mean 'hitch'?" in message
    assert "[cabin] com: give 3 numbers" in message
    assert "[ropes] EA is -1 N, it must be above 0" in message
    assert "[brake] is not a section" in message
    assert "heights must increase, but 0.5 m follows 1 m" in message
    assert len(caught.value.faults) == 6


def test_missing_entries_say_what_they_are(tmp_path):
    with pytest.raises(ParameterError, match=r"\[cabin\] mass is missing: mass in kg"):
        LiftParameters.load(written(tmp_path, 'name = "empty"\n'))


def test_a_friction_coefficient_that_no_shoe_has(tmp_path):
    with pytest.raises(ParameterError, match=r"\[cabin_guide\] mu is 10, it must be at most 2: friction coefficient"):
        LiftParameters.load(written(tmp_path, 'extends = "bench"\n[cabin_guide]\nmu = 10.0\n'))


def test_text_that_is_not_toml(tmp_path):
    with pytest.raises(ParameterError, match="not valid TOML"):
        LiftParameters.load(written(tmp_path, "mass 3"))


def test_a_profile_is_cut_at_the_threshold_and_kept_elsewhere():
    rail = BASE.cabin_guide.right_x
    cut = rail.clipped(2.3e-3)
    assert max(cut.deviation) == pytest.approx(2.3e-3)
    for h in np.linspace(0.0, 2.5, 501):
        # cubic through 8 points for one: the bend of the curve between leaves a few µm at most
        assert cut.at(h) == pytest.approx(min(rail.at(h), 2.3e-3), abs=3e-6)
