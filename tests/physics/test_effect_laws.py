"""Laws of the wider catalogue: at rest, in their limits, their symmetry, and the power that they take."""

from __future__ import annotations

import numpy as np
import pytest

from discrepancy.effects.kinds import kind_named
from discrepancy.effects.law_along_motion import law_forces
from multibody import Model
from multibody import library as lib
from multibody.library.laws import (
    current_against_drop,
    leakage,
    pipe_flow,
    radiated,
    turbulent_flow,
    voltage_drop,
)

TIME = np.linspace(0.0, 4.0, 2001)
LOAD = 30.0 * np.cos(1.3 * TIME)
TIGHT = {"rtol": 1e-10, "atol": 1e-12}


def motion(sign: float = 1.0, speed: float = 0.3, load: np.ndarray = LOAD) -> dict[str, np.ndarray]:
    w = 3.0
    return {
        "position": sign * speed / w * np.sin(w * TIME),
        "velocity": sign * speed * np.cos(w * TIME),
        "acceleration": -sign * speed * w * np.sin(w * TIME),
        "load": load,
    }


def force(kind: str, moved: dict[str, np.ndarray], strengths: dict[str, float], **shape: float) -> np.ndarray:
    return law_forces(kind_named(kind), TIME, moved, [shape], [strengths])[0]


DRY = {"v_s": 1e-3}
DISSIPATIVE = [
    ("stribeck_load_friction", {"share": 0.2}, {"v_stribeck": 0.05, **DRY}),
    ("directional_load_friction", {"driving": 0.3, "resisting": 0.05}, DRY),
    ("quadratic_load_friction", {"curve": 0.01}, DRY),
    ("friction_drift", {"rate": 2.0}, DRY),
    ("viscous_drift", {"rate": 2.0}, {}),
    ("friction_with_temperature", {"slope": 0.1}, {**DRY, "reference": -40.0}),
    ("viscous_with_temperature", {"slope": 0.1}, {"reference": -40.0}),
]
OTHERS = [
    ("stiffness_drift", {"rate": 2.0}, {}),
    ("stiffness_with_temperature", {"slope": 2.0}, {}),
    ("attached_mass", {"mass": 0.4}, {"natural_frequency": 20.0}),
]


@pytest.mark.parametrize(("kind", "strengths", "shape"), DISSIPATIVE)
def test_friction_takes_power_and_never_gives_any(kind, strengths, shape):
    for load in (LOAD, -LOAD):
        moved = motion(load=load)
        assert np.all(force(kind, moved, strengths, **shape) * moved["velocity"] <= 0.0)


@pytest.mark.parametrize(("kind", "strengths", "shape"), [*DISSIPATIVE, *OTHERS])
def test_nothing_acts_at_rest_and_the_opposite_motion_has_the_opposite_force(kind, strengths, shape):
    still = force(kind, motion(speed=0.0), strengths, **shape)
    assert np.array_equal(still, np.zeros_like(still))
    one = force(kind, motion(1.0), strengths, **shape)
    other = force(kind, motion(-1.0, load=LOAD if kind.endswith("temperature") else -LOAD), strengths, **shape)
    # States are integrated to 1e-5; all else is exact.
    assert other == pytest.approx(-one, rel=1e-12, abs=1e-4 * np.max(np.abs(one)) if kind == "attached_mass" else 0.0)


@pytest.mark.parametrize(("kind", "strengths", "shape"), [*DISSIPATIVE, *OTHERS])
def test_force_is_proportional_to_strength(kind, strengths, shape):
    one = force(kind, motion(), strengths, **shape)
    two = force(kind, motion(), {k: 2.0 * v for k, v in strengths.items()}, **shape)
    assert two == pytest.approx(2.0 * one, rel=1e-12)


def test_load_friction_of_equal_sides_is_that_of_one_share():
    one = force("load_dependent_friction", motion(), {"share": 0.2}, **DRY)
    moving = np.abs(motion()["velocity"]) > 4e-3
    same = force("directional_load_friction", motion(), {"driving": 0.2, "resisting": 0.2}, **DRY)
    assert same[moving] == pytest.approx(one[moving], rel=1e-3)  # the levels meet within v_s of rest
    driving = force("directional_load_friction", motion(), {"driving": 0.2, "resisting": 0.0}, **DRY)
    with_load = LOAD * motion()["velocity"] > 0.0
    assert driving[moving & with_load] == pytest.approx(one[moving & with_load], rel=2e-3)
    assert np.max(np.abs(driving[moving & ~with_load])) < 2e-3 * np.max(np.abs(one))
    starts = force("stribeck_load_friction", motion(), {"share": 0.2}, v_stribeck=1e3, **DRY)
    assert starts == pytest.approx(one, rel=1e-6)
    fast = np.abs(motion()["velocity"]) > 0.2
    assert np.max(np.abs(force("stribeck_load_friction", motion(), {"share": 0.2}, v_stribeck=0.03)[fast])) < 1e-12


def test_quadratic_load_friction_is_four_times_larger_at_twice_the_load():
    one = force("quadratic_load_friction", motion(), {"curve": 0.01}, **DRY)
    assert force("quadratic_load_friction", motion(load=2.0 * LOAD), {"curve": 0.01}, **DRY) == pytest.approx(4.0 * one)


@pytest.mark.parametrize(
    ("kind", "strength", "plain", "plain_strength"),
    [
        ("friction_drift", "rate", "coulomb_friction", "coulomb"),
        ("viscous_drift", "rate", "viscous_friction", "viscous"),
        ("stiffness_drift", "rate", "linear_stiffness", "stiffness"),
    ],
)
def test_a_drift_grows_from_nothing_at_its_beginning(kind, strength, plain, plain_strength):
    unit = force(plain, motion(), {plain_strength: 1.0}, **({"v_s": 1e-3} if plain == "coulomb_friction" else {}))
    found = force(kind, motion(), {strength: 0.7}, begin=1.0, **({"v_s": 1e-3} if plain == "coulomb_friction" else {}))
    assert found == pytest.approx(0.7 * (TIME - 1.0) * unit, abs=1e-12)


@pytest.mark.parametrize(
    ("kind", "plain", "plain_strength"),
    [
        ("friction_with_temperature", "coulomb_friction", "coulomb"),
        ("viscous_with_temperature", "viscous_friction", "viscous"),
        ("stiffness_with_temperature", "linear_stiffness", "stiffness"),
    ],
)
def test_a_law_with_temperature_is_that_of_the_model_at_its_reference(kind, plain, plain_strength):
    shape = {"v_s": 1e-3} if plain == "coulomb_friction" else {}
    warm = motion(load=293.15 + 10.0 * np.sin(TIME))
    unit = force(plain, motion(), {plain_strength: 1.0}, **shape)
    assert force(kind, warm, {"slope": 0.3}, **shape) == pytest.approx(3.0 * np.sin(TIME) * unit, abs=1e-10)


def test_an_attached_mass_has_the_response_of_its_closed_form():
    """Steady: force = mass·s²·(ω² + 2ζωs)/(s² + 2ζωs + ω²)·x with s = 3j, once the beginning has died away."""
    w_n, zeta, m = 5.0, 0.5, 0.4
    found = force("attached_mass", motion(), {"mass": m}, natural_frequency=w_n, damping_ratio=zeta)
    s = 3.0j
    factor = -m * s**2 * (w_n**2 + 2 * zeta * w_n * s) / (s**2 + 2 * zeta * w_n * s + w_n**2)
    expected = np.imag(factor * 0.1 * np.exp(s * TIME))
    late = TIME > 3.5  # e^(-ζωt) is below 2e-4
    assert found[late] == pytest.approx(expected[late], abs=2e-3 * np.max(np.abs(expected)))


def test_a_stiffly_attached_mass_is_an_inertia():
    moved = motion()
    moved["position"] = moved["position"] - 0.0
    found = force("attached_mass", moved, {"mass": 0.4}, natural_frequency=400.0, damping_ratio=0.7)
    late = TIME > 0.1
    assert found[late] == pytest.approx(-0.4 * moved["acceleration"][late], abs=0.02 * 0.4 * 0.9)


# -------------------------------------------------------------------- electricity, liquid, heat


def test_a_current_overcomes_the_drop_and_agrees_with_it():
    u = np.linspace(-3.0, 3.0, 61)
    R, drop, i_s = 2.0, 0.8, 1e-3
    i = np.array([current_against_drop(v, R, drop, i_s) for v in u])
    lost = np.array([voltage_drop(k, drop, i_s) for k in i])
    assert R * i + lost == pytest.approx(u, abs=1e-12)
    assert np.all(i * lost >= 0.0)
    assert i == pytest.approx(-i[::-1])
    assert current_against_drop(0.0, R, drop, i_s) == 0.0
    assert [current_against_drop(v, R, 0.0, i_s) for v in u] == [v / R for v in u]


def test_both_motors_settle_at_the_same_speed_against_their_brushes():
    ends = []
    for inductive in (True, False):
        values = {"L": 1e-3} if inductive else {}
        model = Model("motor")
        motor = model.add("motor", lib.DCMotorDrive(R=1.0, k_t=0.1, inductive=inductive, brush_drop=0.7, **values))
        rotor = model.add("rotor", lib.Inertia(J=1e-4))
        drag = model.add("drag", lib.RotaryViscousFriction(viscous=1e-3))
        model.connect(motor.flange, rotor.flange, drag.b)
        model.connect(drag.a, model.ground)
        model.input("voltage", motor.voltage)
        ends.append(model.build().simulate(5.0, inputs={"voltage": 12.0}, **TIGHT)["rotor.speed"][-1])
    assert ends == pytest.approx([0.1 * (12.0 - 0.7) / (1.0 * 1e-3 + 0.1**2)] * 2, rel=1e-6)


def test_the_dead_time_takes_its_voltage_along_the_current():
    model = Model("motor")
    motor = model.add("motor", lib.PMSM(R=0.5, L_d=1e-3, L_q=1e-3, psi=0.05, dead_time_drop=0.6, i_dead=1e-4))
    model.connect(motor.flange, model.ground)
    model.input("V_d", motor.V_d)
    model.input("V_q", motor.V_q)
    run = model.build().simulate(0.1, inputs={"V_d": 3.0, "V_q": 4.0}, **TIGHT)
    assert run["motor.i_d"][-1] == pytest.approx((5.0 - 0.6) / 0.5 * 0.6, rel=1e-6)
    assert run["motor.i_q"][-1] == pytest.approx((5.0 - 0.6) / 0.5 * 0.8, rel=1e-6)


def test_flows_are_odd_take_power_and_meet_their_laws():
    p = np.linspace(-2e5, 2e5, 81)
    q = np.array([pipe_flow(v, 1e8, 1e13) for v in p])
    assert 1e8 * q + 1e13 * q * np.abs(q) == pytest.approx(p, rel=1e-10, abs=1e-6)
    assert [pipe_flow(v, 1e8, 0.0) for v in p] == [v / 1e8 for v in p]
    assert turbulent_flow(4e4, 1e-6, 1.0) == pytest.approx(1e-6 * 200.0, rel=1e-6)
    for law in (lambda v: pipe_flow(v, 1e8, 1e13), lambda v: leakage(v, 1e-9, 1e-6, 10.0)):
        flow = np.array([law(v) for v in p])
        assert np.all(flow * p >= 0.0)
        assert flow == pytest.approx(-flow[::-1])
        assert law(0.0) == 0.0


def test_a_tank_empties_by_its_leaks_as_torricelli_and_the_exponential_say():
    values = {"area": 0.1, "level": 1.0, "p_s": 1e-3}
    weight = 1000.0 * 9.81
    for leak, closed in (
        ({"leak": 1e-7}, lambda t: np.exp(-1e-7 * weight / 0.1 * t)),
        ({"leak_turbulent": 1e-5}, lambda t: (1.0 - 0.5 * 1e-5 * np.sqrt(weight) / 0.1 * t) ** 2),
    ):
        model = Model("tank")
        model.add("tank", lib.Tank(**values, **leak))
        model.add("seal", lib.Pipe(resistance=1e30))  # a port has to be connected
        model.connect("tank.port", "seal.a")
        model.connect("seal.b", model.ground)
        run = model.build().simulate(100.0, **TIGHT)
        assert run["tank.level"] == pytest.approx(closed(run.times), rel=1e-6)


def test_a_body_cools_as_newton_says_and_radiates_nothing_between_equals():
    model = Model("body")
    body = model.add("body", lib.HeatCapacity(capacity=50.0, temperature=350.0, loss_conductance=0.5))
    model.connect(body.port, model.add("none", lib.HeatSource()).port)
    model.input("heat", "none.heat", default=0.0)
    run = model.build().simulate(200.0, **TIGHT)
    assert run["body.temperature"] == pytest.approx(293.15 + 56.85 * np.exp(-0.01 * run.times), rel=1e-9)
    assert radiated(300.0, 300.0, 1e-9) == 0.0
    assert radiated(400.0, 300.0, 1e-9) == pytest.approx(1e-9 * (400.0**4 - 300.0**4))
    assert radiated(300.0, 400.0, 1e-9) == -radiated(400.0, 300.0, 1e-9)


def test_a_body_follows_recorded_surroundings_that_swing():
    """C·dT/dt = −G·(T − T_u) with T_u = T_0 + A·sin(ωt), at rest in the mean: after long the swing of a low-pass."""
    loss, capacity, swing, omega = 0.5, 50.0, 7.0, 0.02
    model = Model("body")
    body = model.add(
        "body",
        lib.HeatCapacity(capacity=capacity, temperature=293.15, loss_conductance=loss, recorded_ambient=True),
    )
    model.connect(body.port, model.add("none", lib.HeatSource()).port)
    model.input("heat", "none.heat", default=0.0)
    model.input("hall", body.surroundings)
    t = np.linspace(0.0, 1500.0, 30_001)
    hall = 293.15 + swing * np.sin(omega * t)
    run = model.build().simulate((0.0, float(t[-1])), inputs={"hall": (t, hall)}, times=t, **TIGHT)
    late = t > 1200.0  # twelve time constants: 6e-6 of the transient are left
    phase = omega * capacity / loss
    expected = 293.15 + swing * (np.sin(omega * t) - phase * np.cos(omega * t)) / (1.0 + phase**2)
    # straight lines between samples cut (ω·step)²/12 = 8e-8 off the sine, the transient adds 2e-5 K
    assert run["body.temperature"][late] == pytest.approx(expected[late], abs=1e-4)
