"""What is given to a gear stage: parameter files, mode files, structures, numbers that make no sense."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gearbox.files.errors import GearError
from gearbox.files.parameters import StageParameters
from gearbox.parts.housing import SEATS, SENSORS, housing_component
from gearbox.parts.housing_modes import ModeSet, clamped_modes, read_modes, rigid_modes, write_modes
from gearbox.parts.shipped_housing import box_modes
from gearbox.stage.model import Structure
from gearbox.stage.stage import GearStage

PLACES = {p: (0.1 * k, 0.05 * k, -0.1) for k, p in enumerate((*SEATS, *SENSORS))}


def test_a_mode_file_comes_back_as_it_was_written(tmp_path: Path) -> None:
    modes = box_modes().first(3)
    back = read_modes(write_modes(modes, tmp_path / "modes.toml"))
    assert np.allclose(back.frequencies, modes.frequencies, rtol=1e-5)
    for place, shape in modes.shapes.items():
        assert np.allclose(back.shapes[place], shape, rtol=1e-5, atol=1e-12)


def test_a_mode_file_with_wrong_sizes_is_refused_by_mode_and_key(tmp_path: Path) -> None:
    text = write_modes(box_modes().first(2), tmp_path / "modes.toml").read_text(encoding="utf-8")
    lines = text.splitlines()
    lines[lines.index("damping = 0.02")] = 'damping = "much"'
    first = next(k for k, line in enumerate(lines) if line.startswith("input_low"))
    lines[first] = "input_low = [1.0, 2.0]"
    lines.append("roof = [0.0, 0.0, 0.0]")
    path = tmp_path / "wrong.toml"
    path.write_text("\n".join(line for line in lines if not line.startswith("base")), encoding="utf-8")
    with pytest.raises(GearError) as caught:
        read_modes(path)
    told = str(caught.value)
    assert "wrong.toml" in told
    for part in (
        "mode 1: 'input_low' has 2 values",
        "mode 1: 'damping' is 'much'",
        "mode 2: there is no 'base'",
        "mode 2: 'roof' is neither a seat nor a sensor",
    ):
        assert part in told


@pytest.mark.parametrize(
    ("text", "told"), [("name = 3\nx = 1", "no modes"), ("[[mode", "not valid TOML"), ("", "no modes")]
)
def test_a_file_that_is_no_mode_file_is_refused(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "modes.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(GearError, match=told):
        read_modes(path)


def test_a_mode_set_checks_its_sizes() -> None:
    shapes = {p: np.zeros((2, 3)) for p in (*SEATS, *SENSORS)}
    with pytest.raises(GearError, match=r"2 frequencies, but 3 damping"):
        ModeSet(name="m", frequencies=np.array([1.0, 2.0]), damping=np.full(3, 0.01), shapes=shapes)
    with pytest.raises(GearError, match=r"need \(2, 3\)"):
        ModeSet(
            name="m",
            frequencies=np.array([1.0, 2.0]),
            damping=np.full(2, 0.01),
            shapes={**shapes, "base": np.zeros((3, 2))},
        )
    with pytest.raises(GearError, match="rise"):
        ModeSet(name="m", frequencies=np.array([2.0, 1.0]), damping=np.full(2, 0.01), shapes=shapes)
    with pytest.raises(GearError, match="not positive"):
        ModeSet(name="m", frequencies=np.array([0.0, 1.0]), damping=np.full(2, 0.01), shapes=shapes)


def test_a_rigid_housing_bounces_at_the_frequency_of_its_mounts() -> None:
    # mounts in the plane of the centre of mass: the vertical motion stands alone, f = √(4k/m)/2π
    places = {p: (0.1, 0.0, 0.1) for p in (*SEATS, *SENSORS)}
    modes = rigid_modes(25.0, (0.3, 0.4, 0.5), places, 2e7, 0.15)
    bounce = np.sqrt(4 * 2e7 / 25.0) / (2 * np.pi)
    assert np.min(np.abs(modes.frequencies - bounce)) < 1e-9 * bounce
    # static: a force at the middle of the mounts moves a rigid body by F / 4k
    middle = rigid_modes(25.0, (0.3, 0.4, 0.5), dict.fromkeys((*SEATS, *SENSORS), (0.0, 0.0, 0.0)), 2e7, 0.15)
    assert middle.static_flexibility("input_low", "y") == pytest.approx(1 / (4 * 2e7), rel=1e-12)


def test_more_modes_than_the_housing_takes_are_refused() -> None:
    count = 41
    shapes = {p: np.zeros((count, 3)) for p in (*SEATS, *SENSORS)}
    modes = ModeSet(name="many", frequencies=np.arange(1.0, count + 1), damping=np.full(count, 0.01), shapes=shapes)
    with pytest.raises(GearError, match=r"first\(40\)"):
        housing_component(modes)
    assert housing_component(modes.first(40)).options["modes"] == 40
    assert housing_component(clamped_modes()).options["modes"] == 0


def test_material_scales_modes() -> None:
    modes = box_modes()
    steel = modes.scaled(modulus=4.0, density=1.0)
    assert np.allclose(steel.frequencies, 2.0 * modes.frequencies)
    assert steel.static_flexibility("base", "y") == pytest.approx(modes.static_flexibility("base", "y") / 4.0)
    heavy = modes.scaled(density=2.0)  # statics do not know the density
    assert heavy.static_flexibility("base", "y") == pytest.approx(modes.static_flexibility("base", "y"))


def test_a_parameter_file_names_every_fault(tmp_path: Path) -> None:
    path = tmp_path / "stage.toml"
    path.write_text(
        'extends = "paper"\n[gears]\nteeth1 = 3\nwidth = "35 kg"\n[contact]\nK = -1.0\n[house]\n', encoding="utf-8"
    )
    with pytest.raises(GearError) as caught:
        StageParameters.load(path)
    told = str(caught.value)
    for part in (
        "stage.toml",
        "[gears] has no entry 'teeth1'",
        "did you mean 'teeth_1'",
        "[gears] width",
        "[contact] K is -1",
        "[house] is not a section",
    ):
        assert part in told


def test_half_a_rolling_element_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "stage.toml"
    path.write_text('extends = "paper"\n[bearings]\nelements = 8.5\n', encoding="utf-8")
    with pytest.raises(GearError, match=r"\[bearings\] elements is 8.5, it must be a whole number: rolling elements"):
        StageParameters.load(path)


def test_a_parameter_file_changes_what_it_names(tmp_path: Path) -> None:
    path = tmp_path / "stage.toml"
    path.write_text('extends = "paper"\nname = "mine"\n[contact]\nC_D = "303 N*s/mm"\n', encoding="utf-8")
    stage = StageParameters.load(path)
    assert pytest.approx(303e3) == stage.contact.C_D
    assert stage.name == "mine"
    assert stage.gears == StageParameters.paper().gears


def test_parts_that_do_not_fit_are_refused() -> None:
    with pytest.raises(GearError, match="root diameter"):
        GearStage(StageParameters.paper().replaced("input_shaft", diameter=0.2))
    with pytest.raises(GearError, match="inside the gear"):
        GearStage(StageParameters.paper().replaced("output_shaft", seat=0.01))
    with pytest.raises(GearError, match=r"\[gears\] .*contact ratio"):
        GearStage(StageParameters.paper().replaced("gears", addendum=0.5))
    with pytest.raises(GearError, match=r"no motion 'roll'"):
        GearStage(structure=Structure(input_free=("roll", "spin")))
    with pytest.raises(GearError, match="spin must be free"):
        GearStage(structure=Structure(output_free=("x",)))
    with pytest.raises(GearError, match="clamped"):
        GearStage(structure=Structure(housing="soft"))


def test_degrees_of_freedom_are_structure() -> None:
    def states(stage: GearStage) -> int:
        return len(stage.build(compiled=False).states)

    assert states(GearStage.paper()) == 2 * 12 + 2 * 16 + 2
    assert states(GearStage.paper(housing="rigid")) == 2 * 12 + 2 * 6 + 2
    assert states(GearStage.paper(housing="clamped")) == 2 * 12 + 2
    assert states(GearStage.torsional(housing="clamped")) == 2 * 2 + 2
    assert states(GearStage.paper(housing="clamped", input_free=("x", "y", "spin"))) == 6 + 12 + 2
    rigid_drive = StageParameters.paper().replaced("drive", stiffness=float("inf"))
    # the drive's two states are the pinion's
    assert states(GearStage(rigid_drive, Structure(housing="clamped"))) == 2 * 12


def test_density_and_modulus_enter_where_they_do() -> None:
    stage = GearStage.paper(housing="clamped")
    heavy = stage.values(rho=2 * 7800.0)
    assert heavy["input_shaft.mass"] == pytest.approx(2 * stage.components["input_shaft"].values["mass"])
    assert "mesh.K" not in heavy
    assert stage.values(E=105e9)["mesh.K"] == pytest.approx(0.5 * 8.6e5)
    assert stage.values(E=105e9, K=7e5)["mesh.K"] == 7e5


def test_numbers_that_make_no_sense_are_refused() -> None:
    stage = GearStage.paper(housing="clamped")
    with pytest.raises(GearError) as caught:
        stage.values(K=float("nan"), stiffnes=1.0, E=-1.0)
    assert len(caught.value.faults) == 3
    with pytest.raises(GearError) as caught:
        stage.simulate(float("inf"), 150.0, -1.0, rate=0.0)
    assert len(caught.value.faults) == 3
    with pytest.raises(GearError, match="fewer than two samples"):
        stage.simulate(1000.0, 150.0, 1e-6)
