"""The housing's modes: a body on mounts, files with mounts, and a box of plates by finite elements."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from gearbox.files.errors import GearError
from gearbox.parts.housing import SEATS, SENSORS, housing_component
from gearbox.parts.housing_modes import ModeSet, read_modes, rigid_modes, write_modes
from gearbox.parts.shipped_housing import PLACES as PLACED
from gearbox.parts.shipped_housing import box_modes
from gearbox.stage.stage import GearStage

MASS, INERTIA, SPAN = 28.0, (0.35, 0.55, 0.62), 0.14
FEET = {
    f"mount_{k}": (sx * SPAN, -0.125, sz * SPAN)
    for k, (sx, sz) in enumerate(((-1, -1), (-1, 1), (1, -1), (1, 1)), start=1)
}


def motion(place: tuple[float, float, float]) -> np.ndarray:
    """Displacement of a point of a free rigid body by its six mass-normalised motions, shape (6, 3)."""
    x, y, z = place
    turn = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
    return (np.hstack([np.eye(3), turn]) / np.sqrt([MASS, MASS, MASS, *INERTIA])).T


def free_body() -> ModeSet:
    shapes, mounts = ({name: motion(p) for name, p in part.items()} for part in (PLACED, FEET))
    return ModeSet(name="free", frequencies=np.zeros(6), damping=np.zeros(6), shapes=shapes, mounts=mounts)


def test_a_free_body_on_its_mounts_is_the_rigid_housing() -> None:
    mounted = free_body().on_mounts(4e7)
    known = rigid_modes(MASS, INERTIA, PLACED, 4e7, SPAN)
    assert mounted.frequencies == pytest.approx(known.frequencies, rel=1e-12)
    for seat in SEATS:
        for axis in "xyz":
            assert mounted.static_flexibility(seat, axis) == pytest.approx(known.static_flexibility(seat, axis))


def test_dampers_of_mounts_damp_what_moves_them() -> None:
    """Stiffness-proportional dampers: every mode has the ratio c·ω/2k, exactly."""
    mounted = free_body().on_mounts(4e7, 3e3)
    assert mounted.damping == pytest.approx(3e3 * 2 * np.pi * mounted.frequencies / (2 * 4e7), rel=1e-12)


def test_a_free_housing_is_refused_until_it_stands_on_something() -> None:
    with pytest.raises(GearError, match=r"held by nothing: put it on mounts with on_mounts"):
        housing_component(free_body())
    with pytest.raises(GearError, match="can still move freely"):
        free_body().on_mounts((0.0, 4e7, 0.0))
    with pytest.raises(GearError, match="no shapes at mounts"):
        box_modes().on_mounts(1e7)
    with pytest.raises(GearError, match="numbers of zero or more"):
        free_body().on_mounts(-1.0)
    shapes = {p: np.zeros((2, 3)) for p in (*SEATS, *SENSORS)}
    with pytest.raises(GearError, match=r"'mount_1' has the size \(3, 3\)"):
        ModeSet(
            name="m",
            frequencies=np.array([1.0, 2.0]),
            damping=np.zeros(2),
            shapes=shapes,
            mounts={"mount_1": np.zeros((3, 3))},
        )
    with pytest.raises(GearError, match="begin it with mount_"):
        ModeSet(
            name="m",
            frequencies=np.array([1.0, 2.0]),
            damping=np.zeros(2),
            shapes=shapes,
            mounts={"foot": np.zeros((2, 3))},
        )


def test_a_mode_file_holds_mounts(tmp_path: Path) -> None:
    path = write_modes(free_body(), tmp_path / "modes.toml")
    back = read_modes(path)
    assert list(back.mounts) == list(FEET)
    assert back.on_mounts(4e7).frequencies == pytest.approx(free_body().on_mounts(4e7).frequencies, rel=1e-5)
    lines = path.read_text(encoding="utf-8").splitlines()
    lines = [line for k, line in enumerate(lines) if not (line.startswith("mount_2") and k > 30)]
    path.write_text("\n".join([*lines, "mount_9 = [0.0, 0.0, 0.0]"]), encoding="utf-8")
    with pytest.raises(GearError) as caught:
        read_modes(path)
    assert "mode 3: there is no 'mount_2'" in str(caught.value)
    assert "mode 6: 'mount_9' is neither a seat nor a sensor, nor a mount of mode 1" in str(caught.value)


def test_a_stage_stands_on_elastic_mounts() -> None:
    stage = GearStage.paper(modes=free_body().on_mounts(4e7))
    assert len(stage.build(compiled=False).states) == 2 * 12 + 2 * 6 + 2


# -------------------------------------------------------------------- finite elements


@cache
def box(held: bool) -> ModeSet:
    pytest.importorskip("skfem", reason="scikit-fem is not installed (the extra [fem])")
    from gearbox.parts.housing_fem import BoxHousing, box_housing_modes

    return box_housing_modes(PLACED, 40 if not held else 16, box=BoxHousing(cells=8), held=held)


def test_a_coarser_box_is_hardly_stiffer_than_the_shipped_one() -> None:
    """Eight elements along it in place of fourteen: up to 4.6 % in the first eight modes, none of them lower."""
    ratio = box(True).frequencies[:8] / box_modes().frequencies[:8]
    assert (ratio > 1.0).all()
    assert (ratio < 1.05).all()


@pytest.mark.slow
def test_the_shipped_modes_are_what_the_command_computes() -> None:
    """``python -m gearbox.parts.shipped_housing``; the file has six digits."""
    pytest.importorskip("skfem", reason="scikit-fem is not installed (the extra [fem])")
    from gearbox.parts.housing_fem import box_housing_modes

    made, shipped = box_housing_modes(PLACED, 16), box_modes()
    assert made.frequencies == pytest.approx(shipped.frequencies, rel=1e-5)
    for place, shape in shipped.shapes.items():
        assert made.shapes[place] == pytest.approx(shape, abs=1e-5)


def test_a_free_box_has_its_mass_and_moves_as_a_rigid_body() -> None:
    """Six motions without frequency; along each axis the sum of their squares at the middle is one over the mass."""
    free = box(False)
    assert (free.frequencies[:6] == 0.0).all()
    assert free.frequencies[6] > 200.0
    volume = np.prod(np.subtract((0.20, 0.125, 0.087), (-0.18, -0.125, -0.087)))
    hollow = np.prod(np.subtract((0.20, 0.125, 0.087), (-0.18, -0.125, -0.087)) - 2 * 0.012)
    mass = 7200.0 * (volume - hollow)
    soft = free.on_mounts(1e4)
    # On springs far softer than the walls, straight up: all mass on four springs; the springs' place adds no tilting.
    bounce = np.sqrt(4 * 1e4 / mass) / (2 * np.pi)
    assert np.min(np.abs(soft.frequencies[:6] / bounce - 1.0)) < 2e-3


def test_stiff_mounts_hold_the_feet() -> None:
    """Modes of the free box on ever stiffer mounts rise towards those of the box whose feet are held, from below."""
    free, fixed = box(False), box(True)
    first = [free.on_mounts(k).frequencies[0] for k in (1e6, 1e7, 1e8, 1e9)]
    assert first == sorted(first)
    assert 0.5 * fixed.frequencies[0] < first[-1] < fixed.frequencies[0]
