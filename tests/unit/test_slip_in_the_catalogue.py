"""Slip of a rigid transmission in the catalogue: where it is asked, and the model with it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from discrepancy.effects.catalogue import Entry, catalogue
from discrepancy.effects.effect import Effect, unit_at
from multibody import Model
from multibody.library import Gear, Inertia, Mass, Rack, SlippingGear, SlippingRack, TorqueSource


def crane(*, efficiency: float | None = None) -> Model:
    """A motor, a gear, a drum and a load."""
    m = Model("crane")
    lossy = {} if efficiency is None else {"efficiency": efficiency}
    gear, drum = m.add("gear", Gear(ratio=4.0, **lossy)), m.add("drum", Rack(radius=0.2))
    m.connect(m.add("drive", TorqueSource()).flange, m.add("motor", Inertia(J=0.1)).flange, gear.a)
    m.connect(gear.b, m.add("shaft", Inertia(J=0.3)).flange, drum.a)
    m.connect(drum.b, m.add("load", Mass(m=20.0)).flange)
    m.input("drive.torque", "drive.torque")
    return m


def slips(model: Model) -> dict[str, Entry]:
    entries = catalogue(model.build(probes=True), ("load.velocity",), ("drive.torque",), include=("slip",))
    return {e.where: e for e in entries}


def test_rigid_transmissions_may_slip_and_those_with_losses_mesh() -> None:
    assert {w: e.domain for w, e in slips(crane()).items()} == {"gear": "rotation", "drum": "translation"}
    assert set(slips(crane(efficiency=0.9))) == {"drum"}


def test_a_transmission_that_slips_in_the_model_is_not_asked_again() -> None:
    with_slip = Effect(kind="slip", where="drum", strengths={"creep": 1e-4}, domain="translation").added_to(crane())
    assert set(slips(with_slip)) == {"gear"}


@pytest.mark.parametrize(
    ("where", "domain", "unit", "component"),
    [("drum", "translation", "1/N", SlippingRack), ("gear", "rotation", "1/(N*m)", SlippingGear)],
)
def test_the_effect_gives_the_machine_its_degree_of_freedom_back(where, domain, unit, component) -> None:
    effect = Effect(kind="slip", where=where, strengths={"creep": 1e-3}, shape={"v_s": 0.02}, domain=domain)
    rigid, model = crane(), effect.added_to(crane())
    assert isinstance(model.components[where], component)
    assert model.components[where].values["creep"] == 1e-3
    assert type(rigid.components[where]) in (Gear, Rack)
    assert len(model.build().state_names) == len(rigid.build().state_names) + 2
    assert effect.parameter_name("creep") == f"{where}.creep"
    assert effect.unit("creep") == unit == unit_at(rigid.build(probes=True), "slip", where)
    (uncertain,) = effect.uncertain()
    assert (uncertain.name, uncertain.value) == (f"{where}.creep", 1e-3)
    assert uncertain.min == pytest.approx(1e-6)
    assert Effect(**dataclasses.asdict(effect)) == effect


def test_slip_without_the_domain_of_its_driven_side_says_so() -> None:
    with pytest.raises(ValueError, match="needs domain='translation' or 'rotation'"):
        Effect(kind="slip", where="drum", strengths={"creep": 1e-3}).unit("creep")


def test_with_hardly_any_creep_the_machine_moves_as_the_rigid_one() -> None:
    effect = Effect(kind="slip", where="drum", strengths={"creep": 1e-7}, domain="translation")
    runs = [
        m.build().simulate(2.0, inputs={"drive.torque": 3.0}, rtol=1e-8, atol=1e-10)
        for m in (crane(), effect.added_to(crane()))
    ]
    np.testing.assert_allclose(runs[1]["motor.speed"][-1], runs[0]["motor.speed"][-1], rtol=1e-5)
