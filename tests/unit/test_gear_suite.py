"""The gear rig as a machine of ``vtsdt validate discrepancy``: names, sizes, what is refused, where it goes on."""

from __future__ import annotations

import json
from dataclasses import asdict

import numpy as np
import pytest

from discrepancy.validation import suite
from discrepancy.validation.trials import Trial
from gearbox.rig import suite as suite_gear
from gearbox.rig.encoders import CYCLES
from gearbox.rig.rig import GearRig
from vtsdt.cli.validate_discrepancy import MACHINES, main


def test_names_are_those_of_the_model_under_test() -> None:
    from discrepancy.effects.catalogue import catalogue
    from gearbox.rig.encoders import build

    outputs = ["transmission_error", "drive_torque"]
    system = build().build(outputs=outputs, compiled=False)
    offered = {e.name for e in catalogue(system, outputs, ["speed", "torque"])}
    hidden = [n for n in suite_gear.names() if not n.startswith("unbalance")]
    assert {"eccentricity@mesh.gear_1", "misalignment@mesh"} <= set(hidden)
    assert set(hidden) <= offered


@pytest.mark.parametrize(
    ("name", "on_rig"),
    [("eccentricity@mesh.gear_2", "eccentricity@output_gear"), ("misalignment@mesh",) * 2, ("profile_error@mesh",) * 2],
)
def test_what_is_hidden_is_what_the_rig_hides(name, on_rig) -> None:
    (effect,) = suite_gear.sizes(5, [name])
    assert f"{effect['kind']}@{effect['where']}" == name
    size = sum(v["value"] ** 2 for v in effect["parameters"].values()) ** 0.5
    assert size == pytest.approx(GearRig(seed=5).faults_of([on_rig])[0].size)


def test_sizes_are_in_the_strengths_of_the_kind() -> None:
    """A pitch error is a pattern on the rig: its strengths are the two to four waves a turn that the pattern has."""
    from gearbox.stage.effects import GEAR_KINDS

    strengths = {k.name: set(k.strengths) for k in GEAR_KINDS}
    for name in suite_gear.names():
        (effect,) = suite_gear.sizes(3, [name])
        assert set(effect["parameters"]) == strengths[effect["kind"]]
    (profile,) = suite_gear.sizes(3, ["profile_error@mesh"])
    assert profile["parameters"]["profile_slope"]["value"] == 0.0 < profile["parameters"]["profile_form"]["value"]
    for where, gear, teeth in (("mesh.gear_1", "input_gear", 32), ("mesh.gear_2", "output_gear", 44)):
        (effect,) = suite_gear.sizes(3, [f"pitch_error@{where}"])
        (fault,) = GearRig(seed=3).faults_of([f"pitch_error@{gear}"])
        ((at, pattern),) = fault.patterns((32, 44)).values()
        angle = 2.0 * np.pi * at / teeth
        of = {k: v["value"] for k, v in effect["parameters"].items()}
        waves = sum(
            of[f"lobes{e}_cos"] * np.cos(n * angle) + of[f"lobes{e}_sin"] * np.sin(n * angle)
            for n, e in ((2, ""), (3, "3"), (4, "4"))
        )
        # as a record begins, tooth 0 is the one that has been reached by then
        left = fault.size * pattern[(at.astype(int) + CYCLES) % teeth] - waves
        for n in (2, 3, 4):
            assert abs(np.sum(left * np.exp(1j * n * angle))) < 1e-12 * teeth


@pytest.mark.parametrize("name", ["eccentricity@mesh.gear_1", "eccentricity@mesh.gear_2"])
def test_the_truth_is_where_the_gears_stand_as_a_record_begins(name: str) -> None:
    """The model under test with the true strengths shows what the encoders see of the gear that runs out of true."""
    case = suite_gear.case(5, [name])
    problem = case.problem(seed=5)
    (truth,) = case.truth["effects"]
    number = name[-1]
    told = {f"mesh.{k}_{number}": v["value"] for k, v in truth["parameters"].items()}
    at = problem.identify[0].outputs.index("transmission_error")

    def swing(values: dict[str, float]) -> float:
        system = problem.model.with_values(values).build(outputs=problem.identify[0].outputs)
        run = problem.identify[0].simulate(system, system.p)
        return float(np.std((problem.identify[0].measured - run)[:, at]))

    other = dict(zip(told, (-told[f"mesh.runout_y_{number}"], told[f"mesh.runout_x_{number}"]), strict=True))
    assert swing(told) < 0.05 * swing({}) < 0.1 * swing(other), "a quarter of a turn on it is as wrong as can be"


def test_the_machine_is_reached_by_its_name_and_hides_no_unknown_force(tmp_path, capsys) -> None:
    assert MACHINES["gear"] == suite_gear.__name__
    with pytest.raises(SystemExit):
        main(["unknown", "--machine", "gear", "--out", str(tmp_path)])
    assert "hides no unknown force" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["masking", "--machine", "gear", "--out", str(tmp_path)])
    assert "leave the suite 'masking' out" in capsys.readouterr().err


def test_trials_that_are_there_are_not_run_again(tmp_path, monkeypatch) -> None:
    """Few seeds unless told otherwise; with all of them in the file nothing is left to do."""

    def none(*arguments: object, **options: object) -> None:
        raise AssertionError("a trial was run again")

    rows = [
        Trial(suite="null", seed=1000 + k, hidden=(), verdict="nothing missing", found=())
        for k in range(suite_gear.TRIALS)
    ]
    (tmp_path / "gear-null.jsonl").write_text("".join(json.dumps(asdict(r)) + "\n" for r in rows))
    monkeypatch.setattr(suite, "_run", none)
    assert main(["null", "--machine", "gear", "--out", str(tmp_path), "--quiet", "--workers", "1"]) == 0
    assert json.loads((tmp_path / "results.json").read_text())["null"] == [["false alarms", 0, suite_gear.TRIALS]]


def test_faults_rig_and_catalogue_have_one_list_of_kinds() -> None:
    from gearbox.rig.hidden import KINDS
    from gearbox.stage.effects import GEAR_KINDS
    from gearbox.stage.faults import FAULTS

    assert {row.kind for row in FAULTS.values()} == {k.name for k in GEAR_KINDS} == set(KINDS)
    assert all(row is FAULTS[row.label] for row in KINDS.values())
