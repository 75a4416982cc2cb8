"""Friction against closed forms: stopping times and distances, with the regularisation's error."""

from __future__ import annotations

import numpy as np
import pytest

import multibody.library as library
from multibody import Model
from multibody.library import laws

M = 2.0


def coasting(law, v0, **values):
    model = Model(law)
    body = model.add("body", library.Mass(m=M, velocity=v0))
    friction = model.add("friction", getattr(library, law)(**values))
    model.connect(friction.a, model.ground)
    model.connect(friction.b, body.flange)
    return model.build()


def test_coulomb_friction_stops_a_body_after_v0_squared_over_two_mu_g():
    F, v0, v_s = 6.0, 1.5, 1e-3
    a = F / M
    stop = v0 / a
    run = coasting("CoulombFriction", v0, coulomb=F, v_s=v_s).simulate(
        1.5 * stop,
        times=stop * np.array([0.0, 0.3, 0.9, 0.999, 1.0, 1.001, 1.5]),
        rtol=1e-10,
        atol=1e-14,
        method="LSODA",
    )
    # m v' = −F tanh(v/v_s) is solved by sinh(v/v_s) = sinh(v0/v_s) exp(−a t/v_s).  Against friction with a
    # jump the speed is at most v_s·arsinh(1/2) ahead, when that one stops, and the way (v_s²/a)·π²/12 longer
    # in the end
    ahead = run["body.velocity"] - np.maximum(v0 - a * run.times, 0.0)
    assert np.all(ahead > -1e-9)
    assert np.max(ahead) == pytest.approx(v_s * np.arcsinh(0.5), rel=1e-4)
    way = run["body.position"][-1] - v0**2 / (2.0 * a)
    assert way == pytest.approx(v_s**2 / a * np.pi**2 / 12.0, rel=0.02)


def test_viscous_friction_halves_the_speed_in_its_time():
    run = coasting("ViscousFriction", 1.0, viscous=4.0).simulate(3.0, rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(run["body.velocity"], np.exp(-4.0 / M * run.times), atol=1e-9)


def test_quadratic_drag():
    run = coasting("QuadraticDrag", 3.0, quadratic=0.8).simulate(3.0, rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(run["body.velocity"], 3.0 / (1.0 + 0.8 * 3.0 / M * run.times), atol=1e-8)


def test_zero_friction_leaves_the_speed_alone():
    run = coasting("CoulombFriction", 0.7, coulomb=0.0).simulate(2.0)
    np.testing.assert_array_equal(run["body.velocity"], 0.7)


@pytest.mark.parametrize(("v", "expected"), [(1.0, 5.0 + 0.4), (-1.0, -3.0 - 0.9), (0.0, 0.0)])
def test_asymmetric_levels(v, expected):
    dry, viscous = laws.asymmetric(v, 5.0, 3.0, 1e-3), laws.one_sided(v, 0.4, 0.9, 1e-3)
    assert dry + viscous * v == pytest.approx(expected, abs=1e-12)  # tanh(1000) is 1 to the last bit


def test_asymmetric_law_never_drives():
    v = np.linspace(-5e-3, 5e-3, 2001)
    power = [x * laws.asymmetric(x, 5.0, 0.0, 1e-3) for x in v]
    assert min(power) >= 0.0


def test_symmetric_limit_of_the_asymmetric_law():
    for v in np.linspace(-4e-3, 4e-3, 17):
        assert laws.asymmetric(v, 5.0, 5.0, 1e-3) == pytest.approx(laws.coulomb(v, 5.0, 1e-3), abs=1e-14)


def test_stribeck_falls_from_static_to_coulomb():
    def law(v):
        return laws.stribeck(v, 4.0, 7.0, 0.05, 2.0, 1e-4)

    assert law(1.0) == pytest.approx(4.0, abs=1e-12)
    assert law(0.05) == pytest.approx(4.0 + 3.0 * np.exp(-1.0), rel=1e-12)
    # the peak lies where tanh has risen and the fall has hardly begun: within (3 v_s/v_stribeck)² of static
    peak = max(law(v) for v in np.linspace(1e-5, 5e-3, 500))
    assert peak == pytest.approx(7.0, rel=(6e-4 / 0.05) ** 2 + 3e-3)
    assert law(-0.2) == -law(0.2)


def test_load_dependent_friction_follows_the_load():
    model = Model("brake")
    brake = model.add("brake", library.LoadDependentFriction(mu=0.3, coulomb=1.0, v_s=1e-3))
    lifting = model.add("lifting", library.LoadDependentFriction(mu=0.3, coulomb=1.0, v_s=1e-3, lifts=True))
    for name, part in (("one", brake), ("two", lifting)):
        model.connect(part.a, model.ground)
        model.connect(part.b, model.add(name, library.Mass(m=M, velocity=1.0)).flange)
    model.input("N", brake.load, lifting.load)
    system = model.build()
    rate = {load: system.rhs(0.0, system.start, np.array([load])) for load in (10.0, -10.0)}
    one, two = system.index("state", "one.velocity"), system.index("state", "two.velocity")
    assert rate[10.0][one] == rate[10.0][two] == rate[-10.0][one] == pytest.approx(-4.0 / M, rel=1e-12)
    assert rate[-10.0][two] == pytest.approx(-1.0 / M, rel=1e-12)


def test_rotary_laws_are_the_same_laws():
    """With the same numbers a rotor of 1 kg m² coasts as a mass of 1 kg does, law by law."""
    values = {
        "ViscousFriction": {"viscous": 0.4},
        "CoulombFriction": {"coulomb": 0.5, "v_s": 0.05},
        "AsymmetricFriction": {"coulomb_forward": 0.5, "coulomb_backward": 0.3, "v_s": 0.05},
        "StribeckFriction": {"coulomb": 0.3, "static": 0.5, "v_stribeck": 0.2, "v_s": 0.05},
        "QuadraticDrag": {"quadratic": 0.6},
    }
    model = Model("twins")
    for name, given in values.items():
        bodies = {"": library.Mass(m=1.0, velocity=0.5), "Rotary": library.Inertia(J=1.0, speed=0.5)}
        for prefix, body in bodies.items():
            part = model.add(f"{prefix}{name}", getattr(library, prefix + name)(**given))
            model.connect(part.a, model.ground)
            model.connect(part.b, model.add(f"{prefix}{name}.body", body).flange)
    run = model.build().simulate(1.0, rtol=1e-8, atol=1e-10)
    for name in values:
        np.testing.assert_allclose(run[f"Rotary{name}.body.speed"], run[f"{name}.body.velocity"], atol=1e-12)
        assert run[f"{name}.body.velocity"][-1] < 0.45


def test_dahl_friction_tends_to_its_level_with_the_way_and_not_with_the_speed():
    """One way from rest: z = 1 − exp(−s/x_s) at every speed; the stiffness of the beginning is coulomb/x_s."""
    F, x_s = 3.0, 2e-3
    for speed in (1e-3, 0.5):
        model = Model("pulled")
        pulled = model.add("pulled", library.PositionSource())
        friction = model.add("friction", library.DahlFriction(coulomb=F, x_s=x_s))
        model.connect(friction.a, model.ground)
        model.connect(friction.b, pulled.flange)
        for signal in ("position", "velocity", "acceleration"):
            model.input(signal, f"pulled.{signal}", default=0.0)
        way = np.linspace(0.0, 5.0 * x_s, 21)
        time = way / speed
        ramp = {
            "position": lambda t, speed=speed: speed * t,
            "velocity": lambda t, speed=speed: speed,
            "acceleration": lambda t: 0.0,
        }
        run = model.build().simulate(time[-1], inputs=ramp, times=time, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(run["friction.resistance"], F * -np.expm1(-way / x_s), atol=1e-6 * F)


def swinging(law, times, **values):
    """A body that swings on a spring against one friction; its run."""
    model = Model("swinging")
    body = model.add("body", library.Mass(m=M, velocity=0.5))
    friction = model.add("friction", law(**values))
    spring = model.add("spring", library.SpringDamper(stiffness=30.0, damping=0.0))
    model.connect(friction.a, spring.a, model.ground)
    model.connect(friction.b, spring.b, body.flange)
    return model.build().simulate(times[-1], times=times, rtol=1e-9, atol=1e-12)


def test_lugre_friction_without_damping_or_fall_is_dahls():
    times, values = np.linspace(0.0, 2.0, 41), {"coulomb": 1.5, "x_s": 2e-3}
    lugre = swinging(library.LuGreFriction, times, **values)
    dahl = swinging(library.DahlFriction, times, **values)
    np.testing.assert_allclose(lugre["body.position"], dahl["body.position"], atol=1e-8)


@pytest.mark.parametrize("ratio", [0.05, 0.7])
def test_lugre_friction_at_rest_is_a_damped_spring(ratio):
    """Near z = 0: m·ẍ + F·t_s/x_s·ẋ + (F/x_s + k)·x = 0, for deflections far below x_s."""
    F, x_s, k = 20.0, 1e-2, 30.0
    stiffness = F / x_s + k
    omega = np.sqrt(stiffness / M)
    t_s = 2.0 * ratio * omega * M * x_s / F
    model = Model("pushed")
    body = model.add("body", library.Mass(m=M, velocity=1e-6 * omega))
    friction = model.add("friction", library.LuGreFriction(coulomb=F, x_s=x_s, t_s=t_s))
    spring = model.add("spring", library.SpringDamper(stiffness=k, damping=0.0))
    model.connect(friction.a, spring.a, model.ground)
    model.connect(friction.b, spring.b, body.flange)
    time = np.linspace(0.0, 6.0 / omega, 61)
    run = model.build().simulate(time[-1], times=time, rtol=1e-9, atol=1e-16)
    damped = omega * np.sqrt(1.0 - ratio**2)
    expected = 1e-6 * omega / damped * np.exp(-ratio * omega * time) * np.sin(damped * time)
    np.testing.assert_allclose(run["body.position"], expected, atol=2e-10)  # |v|·z bends it by z, 1e-4 of 1e-6


def test_lugre_friction_while_sliding_falls_from_breakaway_to_its_level():
    """At constant speed z = g(v): level and Stribeck curve of the paper's eq. (4)."""
    F, b, v_st, x_s = 3.0, 1.5, 0.1, 1e-4
    for speed in (0.01, 0.1, 1.0):
        model = Model("pulled")
        pulled = model.add("pulled", library.PositionSource())
        values = {"coulomb": F, "x_s": x_s, "t_s": 1e-3, "breakaway": b, "v_stribeck": v_st}
        friction = model.add("friction", library.LuGreFriction(**values))
        model.connect(friction.a, model.ground)
        model.connect(friction.b, pulled.flange)
        for signal in ("position", "velocity", "acceleration"):
            model.input(signal, f"pulled.{signal}", default=0.0)
        ramp = {
            "position": lambda t, speed=speed: speed * t,
            "velocity": lambda t, speed=speed: speed,
            "acceleration": lambda t: 0.0,
        }
        end = 50.0 * x_s / speed
        run = model.build().simulate(end, inputs=ramp, times=[0.0, end], rtol=1e-9, atol=1e-12)
        expected = F * (1.0 + (b - 1.0) * np.exp(-((speed / v_st) ** 2)))
        assert run["friction.resistance"][-1] == pytest.approx(expected, rel=1e-6)


def test_a_body_on_dahl_friction_rings_about_where_it_stopped_and_loses_its_energy():
    """It comes to rest without a speed of creep: under a constant force below the level it stands."""
    model = Model("slope")
    body = model.add("body", library.Mass(m=M, velocity=0.5))
    friction = model.add("friction", library.DahlFriction(coulomb=4.0, x_s=1e-4))
    damper = model.add("damper", library.ViscousFriction(viscous=40.0))
    pull = model.add("pull", library.ForceSource())
    model.connect(friction.a, damper.a, model.ground)
    model.connect(friction.b, damper.b, body.flange, pull.flange)
    model.input("pull", pull.force, default=2.0)
    run = model.build().simulate(3.0, times=[2.0, 3.0], rtol=1e-9, atol=1e-12)
    assert abs(run["body.velocity"][-1]) < 1e-7
    assert run["body.position"][1] == pytest.approx(run["body.position"][0], abs=1e-9)
    assert run["friction.resistance"][-1] == pytest.approx(2.0, rel=1e-5)
