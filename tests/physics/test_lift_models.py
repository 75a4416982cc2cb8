"""The lift's models as a whole: structures and state counts, energy, modes, reductions."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from multibody import Model
from vtsdt.files.parameters import LiftParameters
from vtsdt.files.rail_profile import RailProfile
from vtsdt.lift.energy import energy_balance
from vtsdt.lift.lift import Lift, reference
from vtsdt.lift.model import Structure
from vtsdt.lift.modes import modes_along_run, modes_along_trip
from vtsdt.lift.reduction import cabin_against_reference, one_dimensional_against_reference
from vtsdt.lift.structures import structure_table

BODY = [
    "x",
    "y",
    "z",
    "roll",
    "pitch",
    "yaw",
    "v_x",
    "v_y",
    "v_z",
    "w_x",
    "w_y",
    "w_z",
]


def test_state_names_and_order_of_the_reference_follow_table_1():
    drive = [
        "pulley.angle",
        "pulley.speed",
        "support.plate_position",
        "support.tilt_A_angle",
        "support.tilt_B_angle",
        "support.plate_velocity",
        "support.tilt_A_speed",
        "support.tilt_B_speed",
        "machine.i_d",
        "machine.i_q",
        "control.x_d",
        "control.x_q",
        "control.x_omega",
    ]
    wanted = [f"cabin.{n}" for n in BODY] + [f"counterweight.{n}" for n in BODY] + drive
    assert list(Lift.reference().system.state_names) == wanted
    vertical = [f"{side}.{n}" for side in ("cabin", "counterweight") for n in ("z", "v_z")]
    assert list(Lift.one_dimensional().system.state_names) == vertical + drive
    assert list(Lift.cabin().system.state_names) == wanted[:12]


def test_inputs_are_those_of_table_1():
    assert Lift.reference().system.input_names == ("omega_ref", "tau_L")
    assert Lift.one_dimensional().system.input_names == ("omega_ref", "tau_L", "friction_c", "friction_cw")
    assert Lift.cabin().system.input_names == ("F_c",)


def test_state_counts_of_the_table():
    counts = {row.made_by: row.states for row in structure_table()}
    assert counts["Lift.reference()"] == 37
    assert counts["Lift.one_dimensional()"] == 17
    assert counts["Lift.cabin()"] == 12


@pytest.mark.parametrize(("lateral", "rotation"), list(itertools.product([True, False], repeat=2)))
@pytest.mark.parametrize(("vertical", "inclination"), [(True, True), (True, False), (False, False)])
def test_structures_between_the_models_assemble(lateral, rotation, vertical, inclination):
    other, turning = rotation, not lateral  # the counterweight has another structure than the cabin
    structure = Structure(
        cabin_lateral=lateral,
        cabin_rotation=rotation,
        counterweight_lateral=other,
        counterweight_rotation=turning,
        support_vertical=vertical,
        support_inclination=inclination,
    )
    system = Lift(structure=structure).system
    bodies = sum(2 + 4 * a + 6 * b for a, b in ((lateral, rotation), (other, turning)))
    assert len(system.states) == bodies + 7 + 2 * vertical + 4 * inclination


def test_a_lift_without_inclination_of_its_support_makes_a_trip():
    run = Lift.one_dimensional(support_inclination=False, profile=True).trip(
        "up", inputs={"friction_c": 0.0, "friction_cw": 0.0}
    )
    assert run["z_c"][-1] == pytest.approx(1.9, abs=5e-3)  # short of it by stretch and sag, about 3 mm


def test_factories_for_study_files_return_models_at_rest():
    model = reference(height=0.5)
    assert isinstance(model, Model)
    system = model.build()
    assert system.state_names == Lift.reference().system.state_names
    # Newton's method leaves rates below 1e-9 of the largest at its guess
    assert np.abs(system.rhs(0.0, system.start)).max() < 1e-6


def test_a_lift_is_written_to_a_file_and_read_again(tmp_path):
    lift = Lift.reference(profile=True)
    again = Model.load(lift.save(tmp_path / "lift.json")).build()
    x = lift.equilibrium().state
    assert np.array_equal(again.rhs(1.0, x), lift.system.rhs(1.0, x))


def test_the_speed_reference_as_input_and_as_part_of_the_model_give_the_same_trip():
    inside = Lift.one_dimensional(profile=True).trip("up", inputs={"friction_c": 0.0, "friction_cw": 0.0})
    sampled = Lift.one_dimensional().trip("up", inputs={"friction_c": 0.0, "friction_cw": 0.0})
    # straight lines between samples of 1 ms miss a jerk of 1.5 m/s³ by 2e-7 m/s
    assert np.abs(inside["v_c"] - sampled["v_c"]).max() < 1e-6


def test_a_trip_down_from_the_top_is_the_same_wherever_the_angle_is_zero():
    low, high = Lift.reference(), Lift.reference(start=1.9)
    a, b = low.trip("down"), high.trip("down")
    assert a["pulley.angle"][0] == pytest.approx(-19.0)
    assert b["pulley.angle"][0] == 0.0
    # both integrate with rtol 1e-6 on their own steps; the contact makes the error larger than that
    assert np.abs(a["z_c"] - b["z_c"]).max() < 1e-6


def test_energy_of_a_trip_closes_for_both_directions():
    for direction, start in (("up", 0.0), ("down", 1.9)):
        balance = energy_balance(Lift.reference(start=start, profile=True), direction)
        assert balance.closure < 1e-6
        # all the losses of the table together are the integrated ones (trapezoidal rule over 6001 samples: 1e-5)
        lost = sum(e for *_, kind, e in balance.rows if kind == "lost")
        assert lost == pytest.approx(balance.run["energy.lost"][-1], rel=1e-4)
        assert set(balance.to_frame()["kind"]) == {"stored", "lost", "supplied"}


def test_energy_closes_with_a_loss_torque_and_in_the_1d_model():
    speed = Lift.one_dimensional()
    t, omega = speed.speed_reference()
    lost = (t, -0.8 * np.tanh(omega / 0.1))
    balance = energy_balance(speed, inputs={"friction_c": -3.0, "friction_cw": 2.0, "tau_L": lost})
    assert balance.closure < 1e-6
    # 0.8 N m along 19 rad; near standstill tanh takes a little off
    gear = next(e for c, q, _, e in balance.rows if (c, q) == ("pulley", "loss"))
    assert gear == pytest.approx(0.8 * 19.0, rel=0.01)


def test_energy_closes_with_rails_that_are_bent_in_both_directions_and_with_a_payload():
    base = LiftParameters.bench()
    wave = RailProfile((-0.1, 0.4, 0.8, 1.3, 1.9, 2.6), (0.0, 1.1e-3, -0.7e-3, 0.9e-3, -0.4e-3, 0.3e-3))
    bent = dataclasses.replace(base, cabin_guide=dataclasses.replace(base.cabin_guide, left_x=wave, left_y=wave))
    balance = energy_balance(Lift.reference(bent, profile=True, payload=(5.0, 0.1, -0.05, 0.2)))
    assert balance.closure < 1e-6
    names = [f"{c}.{q}" for c, q, *_ in balance.rows]
    assert "payload.potential_energy" in names


def test_measuring_chains_have_gain_and_offset():
    system = Lift.one_dimensional(sensors=True).system
    p = system.parameter_vector({"sensor_F_c.gain": 1.02, "sensor_F_c.offset": -3.0})
    x = system.state_vector({"cabin.z": -0.002})
    y = system.outputs_at(0.0, x, system.u, p)
    tension = y[system.index("output", "ropes.F_c")]
    assert tension > 0.0
    assert y[system.index("output", "sensor_F_c.output")] == pytest.approx(1.02 * tension - 3.0)


def test_a_reference_without_limit_of_jerk_is_trapezoidal():
    base = LiftParameters.bench()
    lift = Lift.one_dimensional(dataclasses.replace(base, trip=dataclasses.replace(base.trip, jerk=0.0)))
    times, omega = lift.speed_reference()
    assert np.trapezoid(omega, times) * base.pulley.R_p == pytest.approx(-1.9, abs=1e-6)
    rates = np.unique(np.round(np.diff(omega) / np.diff(times), 6))
    # straight pieces of ±0.45/0.1 rad/s², and one sample that is cut by each of the four corners
    assert np.sum(np.isclose(np.abs(rates), 4.5) | np.isclose(rates, 0.0)) == 3
    assert rates.size <= 3 + 4


def test_vertical_modes_of_1d_and_reference_agree_within_one_percent_along_the_trip():
    heights = np.array([0.0, 0.95, 1.9])
    full = modes_along_trip(Lift.reference(), heights).vertical()
    flat = modes_along_trip(Lift.one_dimensional(), heights).vertical()
    assert full.shape == flat.shape == (3, 5)
    assert np.abs(full / flat - 1.0).max() < 0.01


def test_modes_while_sliding_have_the_same_vertical_modes():
    lift = Lift.reference(profile=True)
    run = lift.trip("up")
    moving = modes_along_run(lift, run, np.array([2.0, 4.0])).vertical()
    assert moving.shape == (2, 5)
    assert not np.isnan(moving).any()


def test_modes_of_the_1d_model_are_those_of_its_rope_masses_without_damping():
    """A body on its rope with pulley and support held: ω² = EA/(L m)."""
    p = LiftParameters.bench()
    stiff = dataclasses.replace(
        p, ropes=dataclasses.replace(p.ropes, damping=0.0), pulley=dataclasses.replace(p.pulley, J_p=1e6)
    )
    lift = Lift.one_dimensional(stiff, support_vertical=False, support_inclination=False)
    found = modes_along_trip(lift, np.array([0.0])).modes[0].frequency
    wanted = [
        np.sqrt(p.ropes.EA / (length * m)) / (2 * np.pi)
        for length, m in ((p.ropes.L_0_c, p.cabin.mass), (p.ropes.L_0_cw, p.counterweight.mass))
    ]
    # the stretched rope is longer by 5e-4 of its length, but EA/L takes the free length; the pulley weighs 1e6
    assert found == pytest.approx(sorted(wanted), rel=1e-5)


def test_the_reduced_models_follow_the_reference():
    flat = one_dimensional_against_reference()
    assert all(flat.errors[n] < 1e-3 for n in ("zdd_c", "F_c", "i_q"))
    alone = cabin_against_reference()
    assert alone.errors["zdd_c"] < 1e-3


def test_plain_python_and_compiled_code_agree():
    lift = Lift.reference()
    slow = lift.build(compiled=False)
    x = lift.equilibrium().state + 1e-3
    u = np.array([-1.0, 0.1])
    assert slow.rhs(0.3, x, u) == pytest.approx(lift.system.rhs(0.3, x, u), rel=1e-9, abs=1e-9)


def test_the_jacobian_agrees_with_differences():
    lift = Lift.reference()
    system = lift.system
    x = lift.equilibrium().state + 2e-4 * np.sin(np.arange(37.0))
    exact = system.jacobian("x", 0.0, x)
    step = 1e-7
    for k in range(37):
        d = np.zeros(37)
        d[k] = step
        numeric = (system.rhs(0.0, x + d) - system.rhs(0.0, x - d)) / (2 * step)
        # central differences: rounding of 1e-16 times a rate of 1e3 over 1e-7, and the bend of contact and tanh
        assert exact[:, k] == pytest.approx(numeric, rel=2e-4, abs=2e-3 * max(1.0, np.abs(numeric).max()))
