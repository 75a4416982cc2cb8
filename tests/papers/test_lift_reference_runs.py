"""The lift against trajectories of an independent program (other code, other author) of the same bench.

The files are read from VTSDT_REFERENCE.  Bar: RMS difference below 1e-3 of a signal's standard deviation; they
agree to 4e-5 at worst, and to 1e-6 as a rule, but for the two signals named below.
"""

from __future__ import annotations

import json

import numpy as np
import pandas
import pytest

from vtsdt.files.parameters import LiftParameters, RailProfile
from vtsdt.lift.lift import Lift

TIGHT = {"rtol": 1e-9, "atol": 1e-12}
BENCH = LiftParameters.bench()

# z_m moves by 1.4e-6 m (standard deviation); that program lets the whole tension of the slightly inclined ropes act
# on the support, ours its vertical part, as the energy balance needs: 4e-10 m, 4e-4 of the standard deviation.
BARS = {"z_m": 1e-3}
BAR = 1e-4
# phi_A is excited by nothing in this bench: both programs show rounding, below 1e-17 rad.
ROUNDING = {"phi_A": 1e-15}


def read(folder, name):
    return pandas.read_csv(folder / f"{name}.csv.gz")


def compare(run, record, least):
    compared = 0
    for name in record.columns.drop(["t", "omega_ref"], errors="ignore"):
        values = record[name].to_numpy()
        if name not in run.names or not values.any():
            continue
        difference = run[name] - values
        compared += 1
        if name in ROUNDING:
            assert np.abs(difference).max() < ROUNDING[name]
            continue
        relative = np.sqrt(np.mean(difference**2)) / values.std()
        assert relative < BARS.get(name, BAR), f"{name}: {relative:.2e} of its standard deviation"
    assert compared >= least


def inputs_from(record, **columns):
    t = record["t"].to_numpy()
    return {name: (t, record[column].to_numpy()) for name, column in columns.items()}


@pytest.mark.parametrize(
    ("name", "direction", "start", "straight"),
    [
        ("lift_ref_up", "up", 0.0, False),
        ("lift_ref_down", "down", 1.9, False),
        ("lift_ref_aligned_up", "up", 0.0, True),
    ],
)
def test_reference_model(reference_data, name, direction, start, straight):
    parameters = BENCH.straightened() if straight else BENCH
    run = Lift.reference(parameters, start=start, profile=True).trip(direction, **TIGHT)
    compare(run, read(reference_data, name), least=19)


def test_reference_model_with_the_recorded_speed_reference(reference_data):
    record = read(reference_data, "lift_ref_up")
    run = Lift.reference().trip("up", inputs=inputs_from(record, omega_ref="omega_ref"), **TIGHT)
    compare(run, record, least=19)


def test_one_dimensional_model(reference_data):
    friction = inputs_from(read(reference_data, "lift_ref_up"), friction_c="fric_c", friction_cw="fric_cw")
    run = Lift.one_dimensional(profile=True).trip("up", inputs=friction, interpolation="cubic", **TIGHT)
    compare(run, read(reference_data, "lift_1d_up"), least=17)


def test_cabin_model(reference_data):
    tension = inputs_from(read(reference_data, "lift_ref_up"), F_c="F_c")
    record = read(reference_data, "lift_cabin_up")
    run = Lift.cabin().trip("up", inputs=tension, interpolation="cubic", guess={"cabin.z": record["z_c"][0]}, **TIGHT)
    compare(run, record, least=5)


@pytest.mark.parametrize(
    ("name", "start", "straight"),
    [
        ("lift_ref_up", 0.0, False),
        ("lift_ref_down", 1.9, False),
        ("lift_ref_aligned_up", 0.0, True),
    ],
)
def test_the_state_at_rest_of_the_reference_model(reference_data, name, start, straight):
    given = json.loads((reference_data / "initial_states.json").read_text())[name]
    rest = Lift.reference(BENCH.straightened() if straight else BENCH, start=start).equilibrium()
    # lengths and angles of 1e-3; the difference is that of the vertical part of the rope's pull, see above
    assert rest.state == pytest.approx(np.array(given), abs=5e-9)


def test_the_state_at_rest_of_the_1d_model(reference_data):
    given = json.loads((reference_data / "initial_states.json").read_text())["lift_1d_up"]
    rest = Lift.one_dimensional().equilibrium()
    z_c, z_cw, v_c, v_cw, *others = given
    assert rest.state == pytest.approx(np.array([z_c, v_c, z_cw, v_cw, *others]), abs=1e-10)


def test_the_bench_has_the_rail_profiles_of_the_reference(reference_data):
    points = pandas.read_csv(reference_data / "rail_profiles.csv")
    for side in ("cabin", "counterweight"):
        wanted = RailProfile(tuple(points["h_m"]), tuple(points[f"{side}_right_rail_delta_x_m"]))
        ours = getattr(BENCH, f"{side}_guide").right_x
        assert ours.height == wanted.height
        assert ours.deviation == pytest.approx(wanted.deviation, rel=1e-12)
