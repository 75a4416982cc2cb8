"""Efficiency of a trip: E_out over E_in (González et al. 2020, section IV-D), braking and motoring, up and down."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from vtsdt.files.parameters import LiftParameters
from vtsdt.lift.energy import TripEnergy, corrective_actions
from vtsdt.lift.lift import Lift
from vtsdt.whatif.study import what_if


def _bench(cabin: float) -> LiftParameters:
    bench = LiftParameters.bench()
    return dataclasses.replace(bench, cabin=dataclasses.replace(bench.cabin, mass=cabin))


@pytest.fixture(scope="module", params=[(32.0, "up"), (32.0, "down"), (37.0, "up"), (37.0, "down")], ids=str)
def trips(request: pytest.FixtureRequest) -> tuple[bool, dict[str, TripEnergy]]:
    """Whether the machine brakes (the heavier side goes down), and the four trips."""
    mass, direction = request.param
    return (mass < 34.0) == (direction == "up"), corrective_actions(_bench(mass), direction=direction)


def test_either_machine_or_masses_give_the_energy(trips: tuple[bool, dict[str, TripEnergy]]) -> None:
    braking, actions = trips
    for energy in actions.values():
        assert (energy.E_cb > 0.0) == braking
        assert (energy.E_m > 0.0) == braking
        assert 0.0 < energy.eta_t < 1.0


def test_energy_introduced_is_received_or_lost(trips: tuple[bool, dict[str, TripEnergy]]) -> None:
    """What is integrated at the machine's shaft closes the balance; ropes and support take 0.1 J at most."""
    _, actions = trips
    for energy in actions.values():
        assert energy.E_in - energy.E_out == pytest.approx(energy.E_c + energy.E_cw, rel=1e-12)
        assert energy.E_m == pytest.approx(energy.net, abs=0.1)


def test_every_action_is_a_gain_whichever_way_the_cabin_goes(trips: tuple[bool, dict[str, TripEnergy]]) -> None:
    _, actions = trips
    for name in ("straightened", "lubrication", "both"):
        assert actions[name].eta_t > actions["original"].eta_t + 0.01


def test_efficiency_stays_between_zero_and_one() -> None:
    rng = np.random.default_rng(0)
    for e_c, e_cw, e_cb in rng.uniform((0.0, 0.0, -50.0), (30.0, 30.0, 50.0), (500, 3)):
        energy = TripEnergy(e_c, e_cw, e_cb, e_cb - e_c - e_cw)
        assert 0.0 <= energy.eta_t <= 1.0
        assert energy.E_in - energy.E_out == pytest.approx(e_c + e_cw)
    assert TripEnergy(8.0, 4.0, 10.0, -2.0).eta_t == 0.0  # masses and machine both give, and all of it is lost
    assert TripEnergy(0.0, 0.0, -10.0, -10.0).eta_t == 1.0
    assert math.isnan(TripEnergy(0.0, 0.0, 0.0, 0.0).eta_t)


def test_what_if_of_a_trip_down_is_below_one_hundred_percent() -> None:
    study = what_if(samples=0, sections=False, direction="down")
    table = study.to_frame().loc["eta_t [%]"]
    assert ((table > 0.0) & (table < 100.0)).all()
    assert study["original"].nominal.E_m < 0.0  # the machine gives
    assert study.gain("straightened").value > 0.01


def test_a_lift_with_its_own_reference_refuses_the_other_way() -> None:
    with pytest.raises(ValueError, match=r"for a trip down make it with start=1\.9"):
        Lift.reference(profile=True).trip("down")
