"""The stage against statics, energy and Eq. 2: what holds for any gear stage, whatever its housing."""

from __future__ import annotations

import numpy as np

from discrepancy.validation.published import PaperChapter, claimed, unchecked
from gearbox.papers.printed import PAPER
from gearbox.stage.stage import GearStage, simulate

__all__ = ["balances_chapter"]

SPEED, TORQUE = 1000.0, 150.0
_ENERGIES = ("stored", "lost", "supplied")


def balances_chapter() -> PaperChapter:
    """Return the chapter of static transmission, energy balance, mesh lines and efficiency at the base condition."""
    stage = GearStage.paper()
    law = TORQUE / (stage.pair.base_radii[1] * float(np.cos(stage.pair.base_helix_angle)))
    residual, shares = _energies(stage)
    efficiency = 1.0 - sum(shares.values())
    lines = _mesh_share(stage)
    rows = (
        unchecked(
            "mean tooth force at rest over a mesh cycle, 150 N·m",
            "not printed",
            f"{_at_rest(stage):.1f} N; by statics, T/(r_b2 cos β_b), {law:.1f} N",
            "the paper prints no force",
        ),
        unchecked(
            "stored + lost − supplied energy, as a share of what is lost, tolerance 1e-7",
            "not printed",
            f"{residual:.0e}",
            "the paper prints no balance; 0 conserves energy",
        ),
        claimed(
            "share of a healthy stage's acceleration at multiples of the mesh frequency (Eq. 2)",
            "all of it",
            f"{100.0 * lines:.2f} %",
            lines,
            low=0.999,
            bar="above 99.9 %, input seat, y, 0.48 s; what is driven periodically and has settled is periodic",
        ),
        unchecked(
            "efficiency at 1000 r/min and 150 N·m",
            "not printed",
            f"{100.0 * efficiency:.1f} %",
            "lost are " + ", ".join(f"{100.0 * v:.2f} % by {name}" for name, v in shares.items()),
        ),
    )
    return PaperChapter(paper=PAPER, place="Section 4.1", title="balances of the model", rows=rows)


def _at_rest(stage: GearStage) -> float:
    forces, system = [], stage.system
    for angle in (np.arange(8) + 0.5) / 8.0 * 2.0 * np.pi / stage.pair.teeth_1:
        state = stage.static_state(TORQUE, angle=float(angle))
        u = system.input_vector({"speed": 0.0, "torque": TORQUE})
        forces.append(system.outputs_at(0.0, state, u=u)[system.index("output", "mesh_force")])
    return float(np.mean(forces))


def _energies(stage: GearStage) -> tuple[float, dict[str, float]]:
    """Return the residual of the balance and the shares of the power that are lost, over eight mesh cycles."""
    duration = 8 * 60.0 / (SPEED * stage.pair.teeth_1)
    lost = {"tooth friction": "mesh.friction_loss", "contact damping": "mesh.contact_loss"}
    names = [*stage.outputs, *(f"energy.{n}" for n in _ENERGIES), *lost.values()]
    system = stage.build(energy=True, outputs=names)
    run = stage.simulate(SPEED, TORQUE, duration, rate=20000.0, system=system, rtol=1e-7, atol=1e-11)
    stored, gone, given = (run[f"energy.{n}"] - run[f"energy.{n}"][0] for n in _ENERGIES)
    power = float((run["drive_torque"] * run["speed_1"]).mean())
    shares = {name: float(run[output].mean()) / power for name, output in lost.items()}
    out = TORQUE * float(np.abs(run["speed_2"]).mean()) / power
    shares["bearings, drag and housing"] = 1.0 - out - sum(shares.values())
    return float(np.max(np.abs(stored + gone - given)) / gone[-1]), shares


def _mesh_share(stage: GearStage) -> float:
    from gearbox.signals.mesh_lines import energy_share
    from gearbox.signals.signal import Signal

    rate = 10000.0
    _, signals = simulate({}, SPEED, TORQUE, 0.48, rate, stage=stage)
    mesh = SPEED * stage.pair.teeth_1 / 60.0
    return energy_share(Signal(signals["a_input_seat_y"], rate, name="a_input_seat_y"), mesh * np.arange(1, 9))
