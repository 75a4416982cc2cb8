"""A small study with a known answer, shared by the tests of comparing, locating and reporting."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

NOISE = {"drive.force": 0.4, "carriage.position": 2e-5}
# White noise up to 125 Hz, behind the low-pass at 50 Hz: about √0.4 of it is left.
FLOOR = {name: 0.62 * value for name, value in NOISE.items()}
COULOMB = 12.0


def machine(friction: float = 30.0):
    """A carriage with viscous friction, pulled through an elastic drive by a motor of given speed."""
    from multibody import Model
    from multibody.library import Mass, SpringDamper, VelocitySource, ViscousFriction

    model = Model("axis")
    motor = model.add("motor", VelocitySource(time_constant=5e-3))
    drive = model.add("drive", SpringDamper(stiffness=4.0e4, damping=80.0))
    carriage = model.add("carriage", Mass(m=20.0))
    guide = model.add("guide", ViscousFriction(viscous=friction))
    model.connect(drive.a, carriage.flange)
    model.connect(drive.b, motor.flange)
    model.connect(guide.a, carriage.flange)
    model.connect(guide.b, model.ground)
    model.input("reference.speed", motor.reference)
    model.output("drive.force", drive.tension)
    return model


def travel(time: np.ndarray, pauses: bool) -> np.ndarray:
    """Reference speed: forth and back at several speeds, with or without rests between."""
    rng = np.random.default_rng(3 if pauses else 4)
    speed, out = 0.0, []
    dt = time[1] - time[0]
    target, left = 0.0, 0.0
    level = [0.25, -0.25, 0.1, -0.1, 0.4, -0.4] if pauses else [0.3, -0.15, -0.15, 0.2, -0.2]
    k = 0
    for _ in time:
        left -= dt
        if left <= 0:
            resting = pauses and k % 2 == 1
            target = 0.0 if resting else level[(k // (2 if pauses else 1)) % len(level)]
            left = 0.4 if resting else 0.9 + 0.1 * rng.uniform()
            k += 1
        speed += np.clip(target - speed, -3.0 * dt, 3.0 * dt)
        out.append(speed)
    return np.array(out)


def record_of(name: str, seed: int, pauses: bool, hidden):
    """Return a record of the machine with the hidden effect, and sensor noise."""
    from estimation import Record
    from estimation.files.record import RecordedSignal

    time = np.arange(0.0, 10.0, 0.004)
    reference = travel(time, pauses)
    truth = hidden.added_to(machine(34.0)).build(outputs=("drive.force", "carriage.position"))
    run = truth.simulate(
        (0.0, float(time[-1])),
        inputs={"reference.speed": (time, reference)},
        times=time,
        rtol=1e-7,
        atol=1e-10,
    )
    rng = np.random.default_rng(seed)
    signals = {"reference.speed": RecordedSignal(values=reference, unit="m/s", column="v_ref", measured_unit="m/s")}
    for column, output, unit in (("drive_N", "drive.force", "N"), ("x_m", "carriage.position", "m")):
        values = run.outputs[:, truth.index("output", output)] + NOISE[output] * rng.standard_normal(time.size)
        signals[output] = RecordedSignal(values=values, unit=unit, column=column, measured_unit=unit)
    return Record(name=name, path=Path(f"{name}.csv"), time=time, signals=signals, log=("time from column t [s]",))


@pytest.fixture(scope="session")
def small_study():
    """Stages of a study that misses dry friction: as given, recalibrated, with the friction."""
    import dataclasses

    from discrepancy.effects.catalogue import catalogue
    from discrepancy.effects.effect import Effect
    from discrepancy.sensitivities.candidates import candidate_sensitivities
    from discrepancy.stages.stage import AcceptedEffect, RivalExplanation, Stage
    from discrepancy.statistics.scan import scan
    from estimation.fit.calibrate import UncertainParameter, calibrate, evaluate
    from estimation.response.experiment import Experiment
    from estimation.signals.preparation import Preparation

    def build(model):
        return model.build(probes=True)

    plain = machine(25.0)
    system = build(plain)
    place = next(p for p in system.places if p.name == "guide")
    shape = {"v_s": 0.003}
    hidden = Effect.at_place("coulomb_friction", place, strengths={"coulomb": COULOMB}, shape=shape)
    prepare = Preparation(decimate=2, low_pass_hz=50.0)

    def experiment(record):
        return Experiment(
            record=record,
            inputs=("reference.speed",),
            outputs=("drive.force", "carriage.position"),
            preparation=prepare,
        )

    identify = [experiment(record_of("forth_and_back", 11, False, hidden))]
    validate = [experiment(record_of("with_rests", 12, True, hidden).warned("'x_m' stands still for 0.4 s"))]
    uncertain = [
        UncertainParameter(name="guide.viscous", value=25.0, std=20.0, min=0.0, unit="N*s/m"),
        UncertainParameter(name="carriage.m", value=20.0, std=1.0, min=0.0, unit="kg"),
    ]

    def stage(name, model, effects, accepted, parameters):
        wide, slim = build(model), model.build(probes=True, outputs=identify[0].outputs)
        moved = calibrate(slim, identify, parameters, noise=FLOOR)
        held = evaluate(slim, validate, moved, noise=FLOOR)
        fitted = moved.to_dict()
        effects = tuple(e.with_values(fitted) for e in effects)
        return Stage(
            name=name,
            model=model.with_values(fitted),
            system=wide,
            slim=slim,
            effects=effects,
            accepted=accepted,
            identify=moved,
            validate=held,
            sensors=(),
            p=wide.parameter_vector(fitted),
            noise=FLOOR,
        )

    def scanned(found, seed):
        linearised = found.linearised_problem(Preparation(decimate=5, low_pass_hz=20.0))
        names = (
            "coulomb_friction",
            "quadratic_drag",
            "constant_force",
            "added_inertia",
            "sensor_gain",
            "sensor_offset",
            "stribeck_friction",
            "local_bump",
        )
        entries = [
            e
            for e in catalogue(found.system, found.outputs, ("reference.speed",), include=[f"{n}@*" for n in names])
            if f"{e.kind.name}.{e.where}" not in found.model.components
        ]
        candidates, refused = candidate_sensitivities(linearised, entries)
        return scan(linearised.residual(), linearised.sensitivities(), candidates, draws=100, seed=seed), refused

    given = stage("as given", plain, (), None, ())
    recalibrated = stage("recalibrated", plain, (), None, uncertain)
    seen, _ = scanned(recalibrated, 1)
    recalibrated = dataclasses.replace(recalibrated, scan=seen)
    effect = Effect.at_place("coulomb_friction", place, strengths={"coulomb": 1.0}, shape=shape)
    rivals = (
        RivalExplanation(
            kind="stribeck_friction", where="guide", delta_bic=240.0, refitted=True, indistinguishable=False
        ),
        RivalExplanation(kind="local_bump", where="guide", delta_bic=610.0, refitted=False, indistinguishable=False),
    )
    p_value = seen["coulomb_friction@guide"].p_value
    accepted = AcceptedEffect(effect=effect, p_value=p_value, delta_bic=-900.0, rivals=rivals)
    better = stage(
        "+ coulomb_friction@guide",
        effect.added_to(plain),
        (effect,),
        accepted,
        [*uncertain, *effect.uncertain()],
    )
    accepted = dataclasses.replace(accepted, effect=better.effects[0])
    after, refused = scanned(better, 2)
    better = dataclasses.replace(better, accepted=accepted, scan=after)
    return SimpleNamespace(stages=(given, recalibrated, better), refused=refused, noise=FLOOR, hidden=hidden)


@pytest.fixture(scope="session")
def conclusion(small_study):
    """Everything that this study has to say."""
    from discrepancy.conclusion.conclusion import Conclusion
    from discrepancy.effects.effect import Effect

    scan = small_study.stages[-1].scan
    places = {p.name: p for p in small_study.stages[-1].system.places}

    def unit(row):
        if row.where in places:
            effect = Effect.at_place(row.kind, places[row.where])
            return effect.unit(effect.definition.strengths[0])
        return {"sensor_offset": "N" if "force" in row.where else "m"}.get(row.kind, "")

    hidden = tuple((r.kind, r.where, r.smallest_visible_strength, r.strength_that_matters, unit(r)) for r in scan.rows)
    return Conclusion(
        verdict="effect found",
        sentence="Dry (Coulomb) friction of 12 N is missing in the guide. With it, the error of the drive force on "
        "the record "
        "that was held out falls from 13.9 N to 0.24 N, which is the noise of the sensor.",
        stages=small_study.stages,
        refused=(("load_dependent_friction", "guide", "the load hardly changes in these records"),),
        hidden=hidden,
        next_measurement=(
            "Move the carriage at 0.01 m/s in both directions for 20 s: friction that rises at low speed "
            "would show above 0.3 N.",
        ),
        warnings=("with_rests: 'x_m' stands still for 0.4 s",),
        residual_reason="the drive is held by its motor, so the model stays where the record is",
        seed=1,
        level=0.02,
        name="axis",
        paths=("study.toml", "forth_and_back.csv", "with_rests.csv"),
    )


@pytest.fixture(scope="session")
def evidence(conclusion):
    """Its comparisons, and where it fails."""
    from discrepancy.conclusion.conclusion import evidence_of

    return evidence_of(conclusion)


@pytest.fixture(scope="module")
def sticking():
    """Return a study of four trips of the axis, three of them fitted, that lack dry friction at the guide."""
    from discrepancy.rigs.axis import axis_case
    from discrepancy.study.study import Study

    found = Study(axis_case(3, ["coulomb_friction@guide"], trips=4).problem(seed=3))
    found.compare()
    return found
