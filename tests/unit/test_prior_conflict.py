"""A parameter outside its stated uncertainty is reported, and no effect is accepted in its place without a warning."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from discrepancy.problem.problem import Problem, make_experiments
from discrepancy.search.moves.add_one import require_presence
from discrepancy.study.study import Study
from estimation.files.record import Record, RecordedSignal
from estimation.fit.calibrate import UncertainParameter
from multibody import Model
from multibody.library import ForceSource, Mass, Spring, ViscousFriction


def slide(mass: float = 20.0) -> Model:
    model = Model("slide")
    carriage, drive = model.add("carriage", Mass(m=mass)), model.add("drive", ForceSource())
    guide, spring = model.add("guide", ViscousFriction(viscous=30.0)), model.add("spring", Spring(stiffness=400.0))
    model.connect(carriage.flange, drive.flange, guide.a, spring.a)
    model.connect(guide.b, spring.b, model.ground)
    model.input("drive.force", drive.force)
    return model


def study_of(true_mass: float, std: float) -> Study:
    model, rng, time = slide(), np.random.default_rng(7), np.arange(0.0, 12.0, 0.01)
    records = []
    for k, rate in enumerate((0.4, 0.55)):
        force = 60.0 * np.sin(2 * np.pi * rate * time) + 20.0 * np.sin(2 * np.pi * 2.3 * rate * time)
        run = (
            slide(true_mass)
            .build()
            .simulate((0.0, time[-1]), inputs={"drive.force": (time, force)}, times=time, rtol=1e-8)
        )
        position = run["carriage.position"] + 2e-4 * rng.standard_normal(time.size)
        signals = {
            "drive.force": RecordedSignal(values=force, unit="N", column="f", measured_unit="N"),
            "carriage.position": RecordedSignal(values=position, unit="m", column="x", measured_unit="m"),
        }
        records.append(Record(name=f"run{k}", path=Path(f"run{k}.csv"), time=time, signals=signals))
    experiments = make_experiments(model, records, ("drive.force",), ("carriage.position",))
    uncertain = (UncertainParameter(name="carriage.m", value=20.0, std=std, min=1.0, unit="kg"),)
    return Study(
        Problem(
            name="slide",
            model=model,
            uncertain=uncertain,
            identify=experiments,
            noise={"carriage.position": 2e-4},
            include=("added_inertia@*", "coulomb_friction@*", "linear_stiffness@*"),
            residual="simulation",
        )
    )


def test_a_wrong_mass_is_named_beside_the_effect_that_would_replace_it():
    study = study_of(true_mass=24.0, std=0.05)
    conclusion = study.diagnose()
    assert conclusion.accepted, "with 80 deviations between them the effect stands out"
    assert study.prior_conflict is not None
    assert [q.name for q, _ in study.prior_conflict.moved] == ["carriage.m"]
    assert abs(study.prior_conflict.moved[0][1] - 24.0) < 0.1
    told = [w for w in conclusion.warnings if "carriage.m" in w]
    assert told
    assert "stated" in told[0]


def test_a_mass_that_calibration_takes_out_of_its_uncertainty_is_an_effect_or_a_warning():
    given = study_of(true_mass=24.0, std=0.6)
    study = Study(replace(given.problem, search="significance"))
    conclusion = study.diagnose()
    assert abs(study.stages[1].identify["carriage.m"] - 24.0) < 0.2, "calibration leaves little for an effect"
    assert [str(a.effect) for a in conclusion.accepted] == ["added_inertia@guide"]
    assert abs(study.stages[-1].effects[-1].strengths["inertia"] - 4.0) < 3 * 0.6, "known as well as the mass"
    assert "carriage.m = 24.0 kg (stated: 20.0 kg ± 0.600 kg)" in conclusion.sentence
    blind = Study(replace(study.problem, include=("coulomb_friction@*",))).diagnose()
    assert blind.accepted == ()
    assert any("carriage.m = 24.0 kg (stated: 20.0 kg ± 0.600 kg)" in w for w in blind.warnings)
    by_evidence = given.diagnose()
    assert by_evidence.probabilities is not None
    assert by_evidence.accepted == (), "no record is predicted better with it than with the mass"
    assert any("carriage.m = 24.0 kg (stated: 20.0 kg ± 0.600 kg)" in w for w in by_evidence.warnings)


def test_an_effect_that_takes_nothing_away_must_be_known_to_be_there():
    """Where the model is wrong in another way, what brings parameters back is known badly."""
    study = study_of(true_mass=24.0, std=0.6)
    before = study.stage
    decision = study.explain()
    assert decision.accepted is not None
    loud = replace(decision.stage, noise={"carriage.position": 1.0})  # as if the error that goes were no error
    known = study.fitted(loud.name, loud.effects, loud, loud.noise)
    assert require_presence(replace(decision, stage=loud), before, lambda trial: known).accepted is decision.accepted
    vague = replace(known, identify=replace(known.identify, std=100.0 * known.identify.std))
    assert require_presence(replace(decision, stage=loud), before, lambda trial: vague).accepted is None


def test_a_mass_within_its_uncertainty_is_calibrated_and_nothing_is_named():
    study = study_of(true_mass=24.0, std=4.0)
    conclusion = study.diagnose()
    assert conclusion.accepted == ()
    assert study.prior_conflict is None


def test_a_real_effect_is_not_doubted():
    study = study_of(true_mass=20.0, std=0.5)
    from discrepancy.effects.effect import Effect

    place = next(p for p in slide().places() if p.name == "guide")
    effect = Effect.at_place("coulomb_friction", place, strengths={"coulomb": 6.0}, shape={"v_s": 2e-3})
    machine, experiments = effect.added_to(slide()).build(), []
    for e in study.problem.identify:
        force = e.record.signals["drive.force"].values
        run = machine.simulate(
            (0.0, float(e.record.time[-1])), inputs={"drive.force": (e.record.time, force)}, times=e.record.time
        )
        noise = 2e-4 * np.random.default_rng(1).standard_normal(force.size)
        position = replace(e.record.signals["carriage.position"], values=run["carriage.position"] + noise)
        signals = {**e.record.signals, "carriage.position": position}
        experiments.append(replace(e, record=replace(e.record, signals=signals)))
    study = Study(replace(study.problem, identify=tuple(experiments)))
    conclusion = study.diagnose()
    assert [a.effect.kind for a in conclusion.accepted][:1] == ["coulomb_friction"]
    assert study.prior_conflict is None
