"""The virtual axis: repeatable files, what is hidden and not told, and records as a rig writes them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from discrepancy.effects.kinds import SHIPPED, kinds
from discrepancy.problem.model import load_model
from discrepancy.problem.study_file import read_study
from discrepancy.rigs.axis import OUTPUTS, AxisRig, axis_case, entries_of, hidden_in, list_axis, make_axis, trip
from discrepancy.rigs.recording import BenchError, Channel, Logger, RigDisturbance, perturb
from estimation.fit.calibrate import UncertainParameter
from multibody.machine.model import Model

SI = {"reference.position": "m", "motor.torque": "N*m", "carriage.position": "m", "motor.speed": "rad/s"}


def _files(folder: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in sorted(folder.iterdir())}


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings in which nothing is hidden."""
    return make_axis(tmp_path_factory.mktemp("plain"), seed=5, trips=3)


@pytest.fixture(scope="module")
def coulomb(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same with dry friction hidden."""
    return make_axis(tmp_path_factory.mktemp("coulomb"), ["coulomb_friction"], seed=5, trips=3)


# -------------------------------------------------------------------- files


def test_same_seed_same_bytes(coulomb: Path, tmp_path: Path) -> None:
    again = make_axis(tmp_path, ["coulomb_friction@guide"], seed=5, trips=3)
    assert _files(again.parent) == _files(coulomb.parent)


def test_another_seed_gives_other_recordings_and_another_truth(plain: Path, tmp_path: Path) -> None:
    here, there = _files(plain.parent), _files(make_axis(tmp_path, seed=6, trips=3).parent)
    assert {n for n in here if here[n] == there[n]} == {"axis.py", "study.toml"}


def test_study_and_readme_do_not_depend_on_what_is_hidden(plain: Path, coulomb: Path) -> None:
    here, there = _files(plain.parent), _files(coulomb.parent)
    for name in ("study.toml", "README.md", "axis.py"):
        assert here[name] == there[name]
    told = (here["README.md"] + here["study.toml"]).decode().lower()
    assert not [kind for kind in kinds() if kind in told]
    assert "these data are synthetic" in told


def test_hiding_leaves_reference_and_true_parameters_as_they_are(plain: Path, coulomb: Path) -> None:
    one, other = (json.loads((p.parent / "truth.json").read_text()) for p in (plain, coulomb))
    assert one["perturbed"] == other["perturbed"]
    assert one["effects"] == []
    assert one["synthetic"] is True
    records = [read_study(p).read_records(SI).identify[0] for p in (plain, coulomb)]
    same = [np.array_equal(records[0].signals[n].values, records[1].signals[n].values) for n in SI]
    assert same == [n == "reference.position" for n in SI]


def test_truth_holds_every_parameter_with_its_unit(coulomb: Path) -> None:
    truth = json.loads((coulomb.parent / "truth.json").read_text())
    (effect,) = truth["effects"]
    assert (effect["kind"], effect["where"]) == ("coulomb_friction", "guide")
    assert effect["parameters"]["coulomb"]["unit"] == "N"
    assert 0.8 * 12.0 <= effect["parameters"]["coulomb"]["value"] <= 1.2 * 12.0
    assert truth["seed"] == 5


def test_columns_are_read_with_their_units_and_match_the_case_in_memory(plain: Path) -> None:
    case = axis_case(seed=5, trips=3)
    read = read_study(plain).read_records(SI)
    assert [len(read.identify), len(read.validate)] == [2, 1]
    for record, made in zip((*read.identify, *read.validate), (*case.identify, *case.validate), strict=True):
        assert record.warnings == ()
        for name in SI:
            assert record.signals[name].unit == made.signals[name].unit
            # Ten digits are written.
            np.testing.assert_allclose(record.signals[name].values, made.signals[name].values, rtol=2e-9, atol=1e-12)


def test_the_model_beside_the_data_is_the_model_under_test(plain: Path) -> None:
    model = load_model(read_study(plain), Model)
    mine = AxisRig().model
    assert model.build().texts == mine.build().texts
    source = (plain.parent / "axis.py").read_text()
    assert "discrepancy" not in source
    assert len(source.splitlines()) <= 60


def test_dry_axis_hands_its_friction_to_the_model(tmp_path: Path) -> None:
    study = read_study(make_axis(tmp_path, seed=1, trips=2, dry=True))
    assert "dry_friction.coulomb" in study.uncertain
    assert "dry_friction" in load_model(study, Model).components


def test_problem_for_a_study_in_memory() -> None:
    problem = axis_case(seed=5, trips=3).problem(seed=3)
    assert [e.name for e in problem.identify] == ["identify_01", "identify_02"]
    assert problem.seed == 3
    assert problem.identify[0].free == ("controller.integral", "motor.angle", "carriage.position")


# -------------------------------------------------------------------- what is hidden


def test_every_kind_of_one_dimension_can_be_hidden_somewhere() -> None:
    listed = {row["kind"] for row in list_axis()} | {row["kind"] for row in list_axis(dry=True)}
    warm = {name for name in SHIPPED if kinds()[name].signal == "temperature"}  # the axis has none
    assert listed == {*SHIPPED, "unknown_force", "position_loop_gain", "speed_loop_gain", "integral_gain"} - warm


def test_every_effect_changes_what_is_measured() -> None:
    """One model with all of them, each switched on alone, so that it is compiled once."""
    rig = AxisRig(seed=3)
    hidden = hidden_in(rig, [e.name for e in entries_of(rig)])
    model = rig.model
    for each in hidden:
        model = each.added_to(model)
    system = model.build(outputs=OUTPUTS)
    strengths: dict[str, dict[str, float]] = {}
    for each in hidden:
        effect = each.effect
        assert effect is not None
        strengths[str(effect)] = (
            {effect.parameter_name(k): v for k, v in effect.strengths.items()}
            if effect.definition.at != "sensor"
            else {}
        )
    off = {name: 0.0 for group in strengths.values() for name in group}
    for each in hidden:  # absence of a value that is stated wrongly is the stated value
        off |= dict(zip(strengths[str(each.effect)], each.stated, strict=False))
    reference = trip(np.random.default_rng(0), 6.0)
    stamps = rig.logger.stamps(6.0)

    def outputs(values: dict[str, float]) -> np.ndarray:
        run = system.simulate(6.0, inputs={"reference.position": reference}, times=stamps, parameters=values)
        return np.column_stack([run[n] for n in OUTPUTS])

    base = outputs(off)
    # Root mean square of noise and a disturbance of 3 N in records without a hidden effect.
    floor = np.array([0.022, 3e-5, 0.12])
    seen = {
        name: float(np.max(np.sqrt(np.mean((outputs({**off, **group}) - base) ** 2, axis=0)) / floor))
        for name, group in strengths.items()
        if group
    }
    assert {name: size for name, size in seen.items() if size < 0.2} == {}


@pytest.mark.parametrize("kind", ["offset", "gain", "delay", "drift"])
def test_sensor_errors_go_through_the_measuring_chain(kind: str) -> None:
    from estimation.response.sensors import SensorError

    logger = Logger(jitter=0.0)
    channel = Channel(signal="y", column="y_mm", unit="m", measured_unit="mm")
    fine = logger.fine_grid(2.0, 1.0)
    stamps = logger.stamps(2.0)
    read = logger.read(channel, fine, 0.3 * fine, stamps, np.random.default_rng(0), [SensorError("y", kind, 0.01)])
    expected = {
        "offset": 0.3 * stamps + 0.01,
        "gain": 1.01 * 0.3 * stamps,
        "delay": 0.3 * (stamps - 0.01),
        "drift": (0.3 + 0.01) * stamps,
    }
    np.testing.assert_allclose(read, 1e3 * expected[kind], atol=1e-9)


def test_input_error_reaches_the_machine_and_not_the_record() -> None:
    one, other = axis_case(seed=5, trips=2), axis_case(seed=5, trips=2, hide=["input_offset"])
    size = other.truth["effects"][0]["parameters"]["offset"]["value"]
    a, b = one.identify[0], other.identify[0]
    np.testing.assert_array_equal(a.signals["reference.position"].values, b.signals["reference.position"].values)
    # A steady shift of the reference is a steady shift of the carriage; 2 µm is the resolution twice.
    shift = np.mean(b.signals["carriage.position"].values - a.signals["carriage.position"].values)
    assert shift == pytest.approx(size, abs=2e-6)


@pytest.mark.parametrize("over", ["position", "speed", "time"])
def test_a_force_of_no_known_kind_can_be_hidden(over: str) -> None:
    rig = AxisRig(seed=2, over=over)
    (hidden,) = hidden_in(rig, ["unknown_force@guide"])
    hidden.added_to(rig.model).build()
    truth = hidden.truth({})
    assert (truth["kind"], truth["where"], truth["over"]) == ("unknown_force", "guide", over)
    assert truth["parameters"]["level"]["unit"] == "N"


def test_strength_scales_what_is_hidden_and_nothing_else() -> None:
    one, two = (hidden_in(AxisRig(seed=2, strength=f), ["stribeck_friction"])[0].effect for f in (1.0, 2.0))
    assert one is not None
    assert two is not None
    assert two.strengths["breakaway"] == pytest.approx(2.0 * one.strengths["breakaway"])
    assert two.shape == one.shape


# -------------------------------------------------------------------- the rig


def test_without_hidden_effects_only_disturbance_and_noise_are_left() -> None:
    """The model at the true parameters, with its own integrator, against the rig without disturbance."""
    case = axis_case(seed=8, trips=2, disturbance=RigDisturbance(0.0))
    system = case.true_model.build()
    # Noise, and half a step of resolution as white noise of step/√12.
    noise = {
        "motor.torque": np.hypot(4e-3, 1e-3 / 12**0.5),
        "carriage.position": np.hypot(5e-7, 1e-6 / 12**0.5),
        "motor.speed": np.hypot(0.03, 0.05 * 2 * np.pi / 60 / 12**0.5),
    }
    jitter = {"motor.torque": 0.0, "carriage.position": 5e-6 * 0.6, "motor.speed": 5e-6 * 800.0}
    for record in (*case.identify, *case.validate):
        run = system.simulate(
            6.0,
            inputs={"reference.position": (record.time, record.signals["reference.position"].values)},
            times=record.time,
        )
        for name in OUTPUTS:
            rms = float(np.sqrt(np.mean((record.signals[name].values - run[name]) ** 2)))
            # The reference is sampled half as often in the record as in the controller: a tenth more.
            assert rms < 1.1 * np.hypot(noise[name], jitter[name]), name
            assert rms > 0.9 * noise[name], name


def test_parameters_stay_within_prior_and_bounds() -> None:
    priors = [
        UncertainParameter(name="a", value=1.0, std=0.1),
        UncertainParameter(name="b", value=0.1, std=1.0, min=0.0),
    ]
    drawn = [perturb(priors, np.random.default_rng(k)) for k in range(300)]
    a = np.array([d["a"] for d in drawn])
    assert np.max(np.abs(a - 1.0)) <= 0.2
    # Cut at two standard deviations, a normal distribution has 0.88 of its own; 300 draws tell it to 5 %.
    assert np.std(a) == pytest.approx(0.088, rel=0.12)
    assert min(d["b"] for d in drawn) == 0.0


def test_disturbance_has_the_stated_size_and_colour() -> None:
    force = RigDisturbance(2.0).draw(400_000, 1e-3, np.random.default_rng(1))
    # 400 s at a correlation time of 0.5 s: some 400 independent values, 4 % on the root mean square.
    assert np.sqrt(np.mean(force**2)) == pytest.approx(2.0, rel=0.1)
    power = np.abs(np.fft.rfft(force)) ** 2
    frequency = np.fft.rfftfreq(force.size, 1e-3)
    near = power[(frequency > 3.0) & (frequency < 7.0)].mean()
    assert near > 20.0 * power[(frequency > 30.0) & (frequency < 50.0)].mean()
    # Stationary from the first sample on.
    first = [RigDisturbance(2.0).draw(2, 1e-3, np.random.default_rng(k))[0] for k in range(400)]
    assert np.std(first) == pytest.approx(2.0, rel=0.15)


def test_anti_alias_filter_stops_what_cannot_be_sampled_and_delays_nothing() -> None:
    logger = Logger(jitter=0.0)
    channel = Channel(signal="y", column="y", unit="N", measured_unit="N", analogue=True)
    fine, stamps = logger.fine_grid(2.0, 1.0), logger.stamps(2.0)
    rng = np.random.default_rng(0)
    slow = np.sin(2 * np.pi * 20.0 * fine)
    np.testing.assert_allclose(
        logger.read(channel, fine, slow, stamps, rng), np.sin(2 * np.pi * 20.0 * stamps), atol=5e-3
    )
    fast = np.sin(2 * np.pi * 430.0 * fine)  # would read as 70 Hz
    assert np.max(np.abs(logger.read(channel, fine, fast, stamps, rng))) < 5e-3


def test_trips_go_both_ways_at_different_speeds_and_hold() -> None:
    fastest = []
    for seed in range(8):
        time, place = trip(np.random.default_rng(seed), 6.0)
        speed = np.gradient(place, time)
        assert place[0] == 0.0
        assert place.min() >= 0.0
        assert place.max() <= 0.86
        assert speed.max() > 0.05
        assert np.mean(np.abs(speed) < 1e-6) > 0.1
        fastest.append(np.abs(speed).max())
    assert max(fastest) < 0.61
    assert max(fastest) > 1.5 * min(fastest)
    assert any(np.gradient(trip(np.random.default_rng(k), 6.0)[1]).min() < -1e-5 for k in range(3))


# -------------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("hide", "says"),
    [
        (["coulom_friction"], "did you mean 'coulomb_friction'?"),
        (["backlash@guide"], "does not fit there; backlash fits coupling"),
        (["viscous_friction@gide"], "there is no such place; viscous_friction fits guide, motor"),
        (["coulomb_friction", "coulomb_friction@guide"], "asked for twice"),
        (["eccentric"], "there is no effect 'eccentric'"),
        (["unknown_force@nowhere"], "there is no such place"),
    ],
)
def test_what_cannot_be_hidden_is_refused(hide: list[str], says: str) -> None:
    with pytest.raises(BenchError) as caught:
        axis_case(seed=0, hide=hide)
    assert says in str(caught.value)


def test_one_error_lists_all_faults_of_a_rig() -> None:
    with pytest.raises(BenchError) as caught:
        AxisRig(seed=-1, trips=1, strength=0.0, over="temperature", duration=1.0)
    assert len(caught.value.faults) == 5


@pytest.mark.parametrize("strength", [1e300, 1e5, float("inf"), float("nan"), -1.0])
def test_a_strength_that_no_machine_bears_is_refused(strength: float) -> None:
    with pytest.raises(BenchError, match="give a factor above zero and up to 1000"):
        AxisRig(strength=strength)


def test_a_file_is_not_a_folder(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("x")
    with pytest.raises(BenchError, match="is a file: name a folder"):
        make_axis(tmp_path / "taken")
