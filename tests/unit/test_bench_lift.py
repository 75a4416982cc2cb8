"""The virtual lift: reproducible files, hidden effects that stay hidden, and models that the studies build."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest

from discrepancy.effects.effect import Effect
from discrepancy.effects.kinds import kinds
from discrepancy.problem.model import load_model
from discrepancy.problem.study_file import read_study
from discrepancy.rigs.hidden_effects import Hidden
from discrepancy.rigs.recording import BenchError
from multibody.machine.model import Model
from vtsdt.files.parameters import LiftParameters, ParameterError
from vtsdt.lift.lift import Lift
from vtsdt.rig import recordings as bench
from vtsdt.rig.models import build, with_rails
from vtsdt.rig.one_dimensional import PlainLiftRig
from vtsdt.rig.rails import RailSpectrum, draw_rails, rail_tables
from vtsdt.rig.rig import LiftRig
from vtsdt.rig.trips import draw_trip, express


def _files(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in sorted(folder.iterdir())}


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings in which nothing is hidden."""
    return bench.make_lift(tmp_path_factory.mktemp("plain"), seed=5, trips=2)


@pytest.fixture(scope="module")
def hidden(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with dry friction and a wrong weighing floor hidden."""
    folder = tmp_path_factory.mktemp("hidden")
    return bench.make_lift(folder, ["coulomb_friction@cabin.z", "input_offset@friction_c"], seed=5, trips=2)


def test_same_seed_same_bytes_and_another_seed_others(plain: Path, tmp_path: Path) -> None:
    here = _files(plain.parent)
    again = _files(bench.make_lift(tmp_path / "again", seed=5, trips=2).parent)
    assert here == again
    other = _files(bench.make_lift(tmp_path / "other", seed=6, trips=2).parent)
    assert {n for n in here if here[n] == other[n]} == {"study.toml"}


def test_study_and_readme_do_not_reveal_what_is_hidden(plain: Path, hidden: Path) -> None:
    here, there = _files(plain.parent), _files(hidden.parent)
    assert {n for n in here if here[n] == there[n]} == {"study.toml", "README.md"}
    text = (here["README.md"] + here["study.toml"]).decode().lower()
    assert not [kind for kind in kinds() if kind in text]
    assert "these data are synthetic" in text


def test_truth_holds_effects_rails_and_parameters(hidden: Path) -> None:
    truth = json.loads((hidden.parent / "truth.json").read_text())
    assert [(e["kind"], e["where"]) for e in truth["effects"]] == [
        ("coulomb_friction", "cabin.z"),
        ("input_offset", "friction_c"),
    ]
    assert truth["effects"][0]["parameters"]["coulomb"]["unit"] == "N"
    assert set(truth["rails"]) == {
        f"{s}.{n}" for s in ("cabin", "counterweight") for n in ("left_x", "left_y", "right_x", "right_y")
    }
    assert truth["perturbed"]["cabin.mass"]["value"] != truth["perturbed"]["cabin.mass"]["nominal"]


def test_an_error_of_a_recorded_input_is_in_the_recording_alone(plain: Path, hidden: Path) -> None:
    """Dry friction of the cabin hardly changes what the shoes carry, so the offset is what differs."""
    size = json.loads((hidden.parent / "truth.json").read_text())["effects"][1]["parameters"]["offset"]["value"]
    both = [read_study(p).read_records().identify[0].signals["friction_c"].values for p in (plain, hidden)]
    assert np.median(both[1] - both[0]) == pytest.approx(-size, abs=0.1)


def test_the_study_builds_the_1d_model_and_its_columns_fit(plain: Path) -> None:
    study = read_study(plain)
    model = load_model(study, Model)
    system = model.build()
    assert len(system.states) == 17
    assert set(study.inputs) == set(system.input_names)
    records = study.read_records()
    assert [len(records.identify), len(records.validate)] == [1, 1]
    signals = records.identify[0].signals
    assert signals["cabin.z"].unit == "m"
    assert abs(signals["cabin.z"].values[0]) < 5e-3
    assert signals["cabin.z"].values[-1] > 1.5


def test_without_anything_hidden_the_1d_model_follows_the_rig(plain: Path) -> None:
    """At its true parameters the model leaves little but noise and the disturbance of 1 N."""
    study, truth = read_study(plain), json.loads((plain.parent / "truth.json").read_text())
    model = load_model(study, Model).with_values({n: v["value"] for n, v in truth["perturbed"].items()})
    record = study.read_records().identify[0]
    time = record.time
    inputs = {n: (time, record.signals[n].values) for n in study.inputs}
    run = model.build().simulate(float(time[-1]), inputs=inputs, times=time)
    late = time > 2.5  # what the model did not know of the start has died away
    for name, most in (("omega", 0.02), ("i_q", 0.02), ("F_c", 1.5), ("F_cw", 1.5), ("a_c", 0.08)):
        off = run[name] - record.signals[name].values
        assert np.std(off[late]) < most, name


def test_every_kind_that_the_1d_lift_can_have_can_be_hidden() -> None:
    rows = LiftRig().list()
    elastic = {name for name, kind in kinds().items() if kind.elastic}
    gears = {"backlash", "slip"} | elastic  # need a spring or a pair of shafts, which the 1D lift has not
    # The 1D lift has neither a friction of its own nor a temperature, and its controller is part of the machine.
    lacking = {k for k, kind in kinds().items() if kind.needs.endswith("friction") or kind.signal == "temperature"}
    here = {k for k, kind in kinds().items() if not kind.free_form and kind.at not in ("parameter", "signal")} - lacking
    assert here - {r["kind"] for r in rows} <= gears
    assert "unknown_force" in {r["kind"] for r in rows}
    assert {r["where"] for r in rows} >= {"cabin.z", "counterweight.z", "pulley", "F_c", "omega_ref"}
    assert not [r for r in rows if r["where"].startswith("support")]  # trembles only


@pytest.mark.parametrize("name", ["reference", "cabin"])
def test_other_models_know_the_rails(name: str, tmp_path: Path) -> None:
    rig = LiftRig(seed=2, trips=2, under_test=name)
    case = rig.case()
    from vtsdt.rig import texts as bench_texts

    (tmp_path / "study.toml").write_text(bench_texts.study(rig, case), encoding="utf-8")
    for record in (*case.identify, *case.validate):
        (tmp_path / record.path.name).write_text(record.name)
    study = read_study(tmp_path / "study.toml")
    model = load_model(study, Model)
    assert len(model.build().states) == {"reference": 37, "cabin": 12}[name]
    heights = model.components["cabin_guide"].tables["left_y"][0]
    np.testing.assert_allclose(heights, rig.profiles["cabin.left_y"].height)


def test_configurations_are_one_lift_with_other_guides(tmp_path: Path) -> None:
    rig = LiftRig(seed=3, trips=2, only_express=True, loads=(0.0,))
    studies = bench.make_configurations(tmp_path, 2, rig=rig)
    one, two = (json.loads(s.with_name("truth.json").read_text()) for s in studies)
    assert one["perturbed"] == two["perturbed"]
    assert one["rails"] != two["rails"]
    summary = json.loads((tmp_path / "truth.json").read_text())
    assert [r["folder"] for r in summary["cabin.right_x"]] == ["configuration_01", "configuration_02"]
    assert "synthetic" in (tmp_path / "README.md").read_text()


def test_rails_have_the_spectrum_that_is_asked_for() -> None:
    parameters, spectrum = LiftParameters.bench(), RailSpectrum(mean=2e-3, rms_x=4e-4, rms_y=1e-4, length=0.16)
    drawn = [draw_rails(parameters, spectrum, np.random.default_rng(k)) for k in range(200)]
    right = np.array([d["cabin.right_x"].deviation for d in drawn])
    across = np.array([d["counterweight.left_y"].deviation for d in drawn])
    assert right.mean() == pytest.approx(2e-3, abs=2e-5)
    assert right.std() == pytest.approx(4e-4, rel=0.05)
    assert across.std() == pytest.approx(1e-4, rel=0.05)
    step = np.diff(drawn[0]["cabin.right_x"].height[:2])[0]
    apart = np.sqrt(3.0) * step / spectrum.length
    neighbour = np.mean([np.corrcoef(a, b)[0, 1] for a, b in itertools.pairwise(right.T)])
    assert neighbour == pytest.approx((1.0 + apart) * np.exp(-apart), abs=0.015)


def test_trips_stay_in_the_hoistway_and_come_to_rest() -> None:
    p = LiftParameters.bench()
    for k in range(12):
        trip = draw_trip(p, k, np.random.default_rng(k), 6.0, (0.0, 3.0))
        at = trip.height - p.pulley.R_p * trip.angle
        assert at.min() > -1e-9
        assert at.max() < p.hoistway.travel + 1e-9
        assert abs(trip.omega[trip.time > 6.0]).max() == 0.0
        assert trip.load == (0.0, 3.0)[(k // 2) % 2]
    down = express(p, False, 6.0)
    assert down.height - p.pulley.R_p * down.angle[-1] == pytest.approx(0.0, abs=1e-9)


def test_faults_of_settings_are_reported_together() -> None:
    with pytest.raises(BenchError) as refused:
        LiftRig(under_test="cabins", loads=(50.0,), trips=1, duration=4.0)
    assert len(refused.value.faults) == 5
    with pytest.raises(BenchError, match="only the 1D model takes a load"):
        LiftRig(under_test="reference", loads=(2.0,))
    with pytest.raises(ParameterError, match=r"no rail 'cabin\.top'"):
        with_rails(LiftParameters.bench(), {"cabin.top": {"height_m": [0, 1], "delta_mm": [0, 1]}})
    with pytest.raises(ParameterError, match="two lists of one length"):
        with_rails(LiftParameters.bench(), {"cabin.left_x": {"height_m": [0, 1], "delta_mm": [0]}})
    with pytest.raises(ParameterError, match="give one of one_dimensional"):
        build("two_dimensional")


def test_own_rails_go_through_a_table_and_back() -> None:
    drawn = draw_rails(LiftParameters.bench(), RailSpectrum(), np.random.default_rng(4))
    lift = with_rails(LiftParameters.bench(), rail_tables(drawn))
    np.testing.assert_allclose(lift.cabin_guide.left_y.deviation, drawn["cabin.left_y"].deviation, atol=1e-9)


def test_command_lists_and_refuses(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    from vtsdt.cli.bench_lift import _public_words
    from vtsdt.cli.command_line import main

    assert main(["bench", "lift", "--out", str(tmp_path), "--hide", "coulomb_frction"]) == 2
    assert "did you mean 'coulomb_friction'" in capsys.readouterr().err
    assert main(["bench", "lift"]) == 2
    assert "--out DIR is missing" in capsys.readouterr().err
    assert main(["validate", "papers", "--only", "boat", "--out", str(tmp_path)]) == 2
    assert "invalid choice: 'boat'" in capsys.readouterr().err
    assert _public_words(["--seed", "3", "--hide", "a@b", "c", "--trips", "4", "--out", "x"]) == [
        "--seed",
        "3",
        "--trips",
        "4",
    ]


def test_every_motion_of_a_lift_has_a_name_of_its_own() -> None:
    for lift in (Lift.one_dimensional(), Lift.reference(), build()):
        names = [p.name for p in lift.places()]
        assert len(set(names)) == len(names)
        assert {"cabin.z", "counterweight.z", "pulley", "pulley.axis", "support.plate"} <= set(names)


def test_a_weighed_load_hangs_on_the_rope() -> None:
    inputs = {"omega_ref": 0.0, "friction_c": 0.0, "friction_cw": 0.0}
    system = build().build(outputs=["F_c"])
    pull = [system.simulate(8.0, inputs={**inputs, "payload": m}, step=0.01)["F_c"][-100:].mean() for m in (0.0, 3.0)]
    assert pull[1] - pull[0] == pytest.approx(3.0 * 9.80665, rel=0.01)


@pytest.mark.parametrize("rig", [LiftRig, PlainLiftRig])
def test_a_hidden_offset_of_the_speed_reference_moves_the_lift_that_is_asked_to_stand(rig: type[LiftRig]) -> None:
    case = rig(seed=4, trips=2).case(["input_offset@omega_ref"])  # there is no rest with a reference of zero
    offset = case.truth["effects"][0]["parameters"]["offset"]["value"]
    signals = case.problem(seed=4).identify[0].record.signals
    assert not signals["omega_ref"].values[:10].any()
    assert np.mean(signals["omega"].values[:10]) == pytest.approx(offset, rel=0.2)


def test_a_lift_rests_with_its_hysteresis_relaxed() -> None:
    """At rest any deflection of it is an equilibrium, also one at which it holds more than it can."""
    lift = Lift.one_dimensional()
    place = next(p for p in lift.system.places if p.name == "pulley.axis")
    effect = Effect.at_place("hysteresis", place, strengths={"level": 0.3}, shape={"x_s": 0.3})
    hidden = Hidden(effect=effect)
    (state,) = hidden.memory
    system = hidden.added_to(lift.copy()).build()
    anywhere = lift.equilibrium(system=system)
    relaxed = lift.equilibrium(system=system, hold=hidden.memory)
    assert abs(anywhere[state]) > 1.0
    assert relaxed[state] == 0.0
    assert relaxed["machine.i_q"] == pytest.approx(lift.equilibrium()["machine.i_q"], rel=1e-9)
    assert Hidden(effect=Effect.at_place("coulomb_friction", place)).memory == ()
