"""The mesh of two gears by itself: forces that follow from an energy, power that balances, limits, cross-checks.

The equations run as plain Python here: nothing is compiled.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from gearbox.files.geometry import GearPair
from gearbox.files.parameters import StageParameters
from gearbox.parts.mesh import HelicalMesh
from gearbox.parts.shafts import GearShaft
from gearbox.stage.model import MOTIONS, line_count, mesh_values
from multibody import Model
from multibody.machine.model import System

PAPER = StageParameters.paper()
PAIR = PAPER.gears.pair()
WITHOUT_LOSS = {"mesh.C_D": 0.0, "mesh.mu_s": 0.0, "mesh.mu_d": 0.0}
FLAWS = {
    "mesh.eccentricity_1": 15e-6,
    "mesh.eccentricity_2": 10e-6,
    "mesh.high_1": 0.4,
    "mesh.high_2": 2.0,
    "mesh.profile_slope": 4e-6,
    "mesh.profile_form": -3e-6,
    "mesh.wear": 2e-6,
    "mesh.misalignment": 2e-4,
    "mesh.pitch_1": 5e-6,
    "mesh.spall_1": 20e-6,
    "mesh.crack_2": 0.3,
    "mesh.chip_2": 0.2,
}


@cache
def pair_system(slices: int = 0, imperfect: bool = False, helix: float | None = None, relief: float = 0.0) -> System:
    """Two free gears in mesh and nothing else; ``helix`` (rad) replaces the paper's angle, both tips have a relief."""
    parameters = PAPER if helix is None else PAPER.replaced("gears", helix_angle=helix)
    if relief:
        parameters = parameters.replaced("gears", relief_1=relief, relief_2=relief)
    model = Model("pair")
    for number in (1, 2):
        mass, J, J_t = parameters.body(number - 1)
        model.add(f"gear_{number}", GearShaft(mass=mass, J=J, J_t=J_t))
    values = mesh_values(parameters)
    if imperfect:
        values["pattern_1"] = (np.arange(33.0), np.sin(np.arange(33.0)))
    mesh = model.add(
        "mesh",
        HelicalMesh(slices=slices, imperfect=imperfect, lines=line_count(parameters.gears.pair()), **values),
    )
    for number in (1, 2):
        for motion in MOTIONS:
            model.connect(f"gear_{number}.{motion}", getattr(mesh, f"{motion}_{number}"))
    return model.build(compiled=False)


def state_at(
    system: System, rng: np.random.Generator | None, roll: float, depth: float, moving: float = 0.0
) -> np.ndarray:
    """A state in the mesh cycle with the flanks pressed in by ``depth`` (m), the rest random and small."""
    x = np.zeros(len(system.states))
    lateral = {"x": 3e-6, "y": 3e-6, "z": 3e-6, "tilt_x": 5e-5, "tilt_y": 5e-5}
    for number in (1, 2):
        for motion, size in lateral.items():
            where = f"gear_{number}.{motion}_{'angle' if 'tilt' in motion else 'position'}"
            rate = f"gear_{number}.{motion}_{'speed' if 'tilt' in motion else 'velocity'}"
            if rng is not None:
                x[system.index("state", where)] = size * rng.uniform(-1, 1)
                x[system.index("state", rate)] = moving * 1e3 * size * rng.uniform(-1, 1)
    angle = roll * PAIR.base_pitch / PAIR.base_radii[0]
    x[system.index("state", "gear_1.spin_angle")] = angle
    lead = depth / np.cos(PAIR.base_helix_angle)
    x[system.index("state", "gear_2.spin_angle")] = (lead - PAIR.base_radii[0] * angle) / PAIR.base_radii[1]
    x[system.index("state", "gear_1.spin_speed")] = moving * 104.7
    x[system.index("state", "gear_2.spin_speed")] = -moving * 104.7 / PAIR.ratio * 1.0001
    return x


def outputs(system: System, x: np.ndarray, p: np.ndarray) -> dict[str, float]:
    return dict(zip(system.output_names, system.outputs_at(0.0, x, p=p), strict=True))


def generalised_forces(system: System, x: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Forces on all twelve motions (accelerations times inertia), and the indices of their states."""
    rates = system.rhs(0.0, x, p=p)
    where, forces = [], []
    for number in (1, 2):
        mass, J, J_t = PAPER.body(number - 1)
        for motion in MOTIONS:
            inertia = J if motion == "spin" else J_t if "tilt" in motion else mass
            turns = "tilt" in motion or motion == "spin"
            where.append(system.index("state", f"gear_{number}.{motion}_{'angle' if turns else 'position'}"))
            forces.append(
                inertia * rates[system.index("state", f"gear_{number}.{motion}_{'speed' if turns else 'velocity'}")]
            )
    return np.array(where), np.array(forces)


@pytest.mark.parametrize("imperfect", [False, True])
@pytest.mark.parametrize("depth", [40e-6, -260e-6], ids=["front flanks", "back flanks"])
def test_forces_are_the_slopes_of_the_elastic_energy(imperfect: bool, depth: float) -> None:
    system = pair_system(imperfect=imperfect)
    p = system.parameter_vector({**WITHOUT_LOSS, **(FLAWS if imperfect else {})})
    rng = np.random.default_rng(5)
    for roll in (0.13, 0.41, 0.77):
        x = state_at(system, rng, roll, depth)
        where, forces = generalised_forces(system, x, p)
        assert np.max(np.abs(forces)) > 100.0  # they touch
        for k, force in zip(where, forces, strict=True):
            h = 2e-9
            energies = []
            for step in (-h, h):
                moved = x.copy()
                moved[k] += step
                energies.append(outputs(system, moved, p)["mesh.energy"])
            slope = -(energies[1] - energies[0]) / (2 * h)
            # Gauss's rule on pieces whose ends move is exact to about 1e-5 of the force; a spall's edge to 1e-3
            reach = {True: 3e-3, False: 1e-4}[imperfect]
            assert force == pytest.approx(
                slope, abs=reach * np.max(np.abs(forces)) * (0.1 if abs(force) < 100 else 1.0)
            )


@pytest.mark.parametrize("imperfect", [False, True])
def test_power_balances(imperfect: bool) -> None:
    """What the mesh takes from the bodies is what its energy gains plus what damping and friction turn into heat."""
    system = pair_system(imperfect=imperfect)
    p = system.parameter_vector(FLAWS if imperfect else {})
    rng = np.random.default_rng(7)
    for roll in (0.21, 0.56, 0.93):
        x = state_at(system, rng, roll, 45e-6, moving=1.0)
        where, forces = generalised_forces(system, x, p)
        rates = np.array([x[system.rate_states[int(k)]] for k in where])
        gyroscopic = 0.0  # does no work
        y = outputs(system, x, p)
        h = 1e-8
        later, before = x.copy(), x.copy()
        later[where] += h * rates
        before[where] -= h * rates
        gain = (outputs(system, later, p)["mesh.energy"] - outputs(system, before, p)["mesh.energy"]) / (2 * h)
        taken = -float(forces @ rates) + gyroscopic
        given = gain + y["mesh.contact_loss"] + y["mesh.friction_loss"]
        size = abs(gain) + abs(y["mesh.contact_loss"]) + abs(y["mesh.friction_loss"])
        assert taken == pytest.approx(given, abs=2e-3 * size)
        assert y["mesh.contact_loss"] >= 0.0
        assert y["mesh.friction_loss"] > 0.0


def test_moving_line_and_fixed_slices_agree() -> None:
    line, slices = pair_system(), pair_system(slices=400)
    p_line, p_slices = line.parameter_vector(), slices.parameter_vector()
    rng = np.random.default_rng(3)
    for roll in (0.05, 0.33, 0.68):
        x = state_at(line, rng, roll, 40e-6, moving=1.0)
        _, a = generalised_forces(line, x, p_line)
        _, b = generalised_forces(slices, x, p_slices)
        # 400 slices: each carries 1/400 of the face, at the ends of a line half of it is missed; friction jumps between
        assert np.max(np.abs(a - b)) < 2e-3 * np.max(np.abs(a))


def test_lines_that_let_go_agree_with_slices() -> None:
    """A damper ten times Table 2's would pull where flanks part: there they carry nothing, and it matters where."""
    line, slices = pair_system(), pair_system(slices=1000)
    hard = {"mesh.C_D": 860e3, "mesh.K": 4.3e5, "mesh.e": 2.5}
    rng = np.random.default_rng(11)
    held = []
    for roll, parting in ((0.1, 2e-4), (0.35, 4e-4), (0.6, 6e-4), (0.85, 8e-4)):  # m/s
        x = state_at(line, rng, roll, 60e-6, moving=0.03)
        driving = PAIR.base_radii[0] * x[line.index("state", "gear_1.spin_speed")]
        x[line.index("state", "gear_2.spin_speed")] = -(parting + driving) / PAIR.base_radii[1]
        a, b = (outputs(s, x, s.parameter_vector(hard)) for s in (line, slices))
        without = outputs(line, x, line.parameter_vector({**hard, "mesh.C_D": 0.0}))["mesh.force"]
        assert a["mesh.force"] == pytest.approx(b["mesh.force"], abs=5e-4 * without)
        assert a["mesh.contact_loss"] == pytest.approx(b["mesh.contact_loss"], rel=5e-3)
        held.append(a["mesh.force"] / without)
    assert 0.0 < min(held) < 0.3  # most of it has let go


def test_slices_converge_towards_the_line() -> None:
    line = pair_system()
    x = state_at(line, None, 0.3, 40e-6)
    wanted = outputs(line, x, line.p)["mesh.force"]
    errors = []
    for n in (31, 124):
        system = pair_system(slices=n)
        errors.append(abs(outputs(system, x, system.p)["mesh.force"] / wanted - 1.0))
    assert errors[0] < 0.01
    assert errors[1] < 0.3 * errors[0]


def test_force_of_a_full_face_pair_is_the_law() -> None:
    # spur gears in single contact: one line over the whole face, δ everywhere the same (deeper, and the neighbours'
    # tips would touch before and after their path)
    pair = GearPair.paper(helix_angle=1e-12)
    system = pair_system(helix=1e-12)
    x = np.zeros(len(system.states))
    depth = 20e-6
    x[system.index("state", "gear_2.spin_angle")] = depth / pair.base_radii[1]
    assert outputs(system, x, system.p)["mesh.force"] == pytest.approx(8.6e5 * 0.02**2, rel=1e-9)


def test_tip_relief_takes_from_a_spur_gear_what_its_parabola_says() -> None:
    """One line lies along the whole face: each pair carries K·(δ − relief·q²)^e, q along the last 3 mm before a tip."""
    relief, depth = 15e-6, 40e-6
    system = pair_system(helix=0.0, relief=relief)
    pair = PAPER.replaced("gears", helix_angle=0.0).gears.pair()
    p = system.parameter_vector(WITHOUT_LOSS)
    seen = set()
    for roll in np.arange(20) / 20:
        x = np.zeros(len(system.states))
        angle = roll * pair.base_pitch / pair.base_radii[0]
        x[system.index("state", "gear_1.spin_angle")] = angle
        x[system.index("state", "gear_2.spin_angle")] = (depth - pair.base_radii[0] * angle) / pair.base_radii[1]
        wanted, near = 0.0, False
        for tooth in (-1, 0, 1, 2):
            s = (roll - tooth) * pair.base_pitch
            gap = 0.0
            for place, edge in ((s, pair.path_end), (depth - s, -pair.path_start)):  # tip of gear 1, tip of gear 2
                near |= edge < place < edge + pair.reach(depth) * 1.1  # beyond the path: the corner's own gap
                gap += relief * min(max((place - edge + 3e-3) / 3e-3, 0.0), 1.0) ** 2
                seen.add(0.0 < gap < relief)
            if pair.path_start < s < pair.path_end:
                wanted += 8.6e5 * (max(depth - gap, 0.0) * 1e3) ** 2.0
        if not near:
            assert outputs(system, x, p)["mesh.force"] == pytest.approx(wanted, rel=1e-9), roll
    assert True in seen


@pytest.mark.parametrize("relief", [20e-6, 60e-6])  # less and more than what the teeth are pressed in by
def test_tip_relief_keeps_forces_the_slopes_of_the_energy_and_agrees_with_slices(relief: float) -> None:
    system, slices = pair_system(relief=relief), pair_system(slices=400, relief=relief)
    p = system.parameter_vector(WITHOUT_LOSS)
    for roll in (0.13, 0.41, 0.77):
        x = state_at(system, np.random.default_rng(5), roll, 40e-6)
        where, forces = generalised_forces(system, x, p)
        for k, force in zip(where, forces, strict=True):
            energies = []
            for step in (-2e-9, 2e-9):
                moved = x.copy()
                moved[k] += step
                energies.append(outputs(system, moved, p)["mesh.energy"])
            assert force == pytest.approx(-(energies[1] - energies[0]) / 4e-9, abs=1e-3 * np.max(np.abs(forces)))
        a, b = (outputs(s, x, s.parameter_vector(WITHOUT_LOSS))["mesh.force"] for s in (system, slices))
        # midpoints of 400 slices: a smooth force to a hundred-thousandth
        assert a == pytest.approx(b, rel=1e-5)
        assert a < outputs(pair_system(), x, pair_system().parameter_vector(WITHOUT_LOSS))["mesh.force"]


def test_gears_apart_do_not_feel_each_other() -> None:
    system = pair_system()
    between = -0.5 * PAIR.normal_backlash
    x = state_at(system, None, 0.4, between, moving=1.0)
    y = outputs(system, x, system.p)
    assert y["mesh.force"] == y["mesh.back_force"] == 0.0
    assert np.all(system.rhs(0.0, x)[list(system.rate_states.values())] == 0.0)


def test_the_back_flanks_touch_beyond_the_backlash() -> None:
    system = pair_system()
    inside, beyond = (state_at(system, None, 0.4, -PAIR.normal_backlash + d) for d in (1e-6, -40e-6))
    assert outputs(system, inside, system.p)["mesh.back_force"] == 0.0
    y = outputs(system, beyond, system.p)
    assert y["mesh.force"] == 0.0
    assert y["mesh.back_force"] > 500.0


def test_front_and_back_flanks_are_alike() -> None:
    """Over a mesh cycle both flanks carry the same mean force for the same penetration."""
    system = pair_system()
    rolls = (np.arange(16) + 0.5) / 16
    front = [outputs(system, state_at(system, None, r, 40e-6), system.p)["mesh.force"] for r in rolls]
    depth = -PAIR.normal_backlash - 40e-6
    back = [outputs(system, state_at(system, None, r, depth), system.p)["mesh.back_force"] for r in rolls]
    assert np.mean(back) == pytest.approx(np.mean(front), rel=1e-4)
    assert np.ptp(back) == pytest.approx(np.ptp(front), rel=0.05)


def test_the_other_hand_turns_the_axial_force_round() -> None:
    angle = np.radians(13.0)
    right, left = pair_system(helix=angle), pair_system(helix=-angle)
    a, b = (outputs(s, state_at(s, None, 0.3, 40e-6), s.p) for s in (right, left))
    for name, sign in (("force", 1), ("force_x", 1), ("force_y", 1), ("force_z", -1), ("moment_y_1", -1)):
        assert b[f"mesh.{name}"] == pytest.approx(sign * a[f"mesh.{name}"], rel=1e-9), name
    # a right-handed driver that turns to the left presses itself along +z
    assert a["mesh.force_z"] < 0.0


def test_contact_never_pulls() -> None:
    system = pair_system()
    x = state_at(system, None, 0.3, 5e-6)
    x[system.index("state", "gear_2.spin_speed")] = -1e4  # torn apart
    assert outputs(system, x, system.p)["mesh.force"] == 0.0


def test_a_missing_tooth_carries_nothing_and_others_what_they_did() -> None:
    system = pair_system(imperfect=True)
    x = state_at(system, None, 0.0, 40e-6)
    whole = outputs(system, x, system.p)["mesh.force"]
    parts = [
        whole
        - outputs(system, x, system.parameter_vector({"mesh.crack_1": 1.0, "mesh.damaged_1": float(k)}))["mesh.force"]
        for k in (-2, -1, 0, 1, 2)
    ]
    assert sum(parts) == pytest.approx(whole, rel=1e-12)
    assert parts[2] == max(parts)
    same = outputs(system, x, system.parameter_vector({"mesh.crack_1": 1.0, "mesh.damaged_1": 32.0}))["mesh.force"]
    assert whole - same == pytest.approx(parts[2])  # tooth 32 of 32 is tooth 0


@pytest.mark.parametrize(
    "name",
    [
        "eccentricity_1",
        "pitch_1",
        "profile_slope",
        "wear",
        "misalignment",
        "variation_2",
        "crack_1",
        "chip_2",
        "spall_1",
    ],
)
def test_flaws_of_severity_zero_are_absent(name: str) -> None:
    plain, flawed = pair_system(), pair_system(imperfect=True)
    x = state_at(plain, np.random.default_rng(1), 0.3, 40e-6, moving=1.0)
    assert np.array_equal(plain.rhs(0.0, x), flawed.rhs(0.0, x, p=flawed.parameter_vector({f"mesh.{name}": 0.0})))
