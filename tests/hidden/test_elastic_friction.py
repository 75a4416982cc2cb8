"""Dry friction that gives way before it slides is how the machine's own friction is, and no effect that is missing."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from plain_machines import RECORDS, low_passed, written
from scipy.integrate import solve_ivp

from discrepancy.effects.effect import Effect
from discrepancy.evidence import elastic_friction
from discrepancy.evidence.proposals import Proposal
from discrepancy.evidence.search import EvidenceSearch
from discrepancy.evidence.trials import Trials
from discrepancy.study.study import Study
from multibody.library import DahlFriction

LEVEL, DISPLACEMENT = 6.0, 4e-4  # N, m

SLIDE = """
from multibody import Model
from multibody import library as lib


def slide():
    m = Model("slide")
    mass = m.add("carriage", lib.Mass(m=2.0))
    spring = m.add("spring", lib.SpringDamper(stiffness=200.0, damping=8.0))
    dry = m.add("dry", lib.CoulombFriction(coulomb=5.0, v_s=1e-3))
    push = m.add("push", lib.ForceSource())
    m.connect(mass.flange, spring.b, dry.b, push.flange)
    m.connect(spring.a, dry.a, m.ground)
    m.input("push.force", push.force)
    return m
"""

STUDY = """
[model]
build = "models.py:slide"

[uncertain]
"carriage.m" = { value = 2.0, std = 0.1, min = 0.0 }
"spring.stiffness" = { value = 200.0, std = 20.0, min = 0.0 }
"spring.damping" = { value = 8.0, std = 2.0, min = 0.0 }
"dry.coulomb" = { value = 5.0, std = 1.0, min = 0.0 }

[inputs]
"push.force" = { column = "force_N" }

[outputs]
"carriage.position" = { column = "position_m", noise = 1e-5 }
"carriage.velocity" = { column = "velocity_m_s", noise = 1e-3 }
"""


def slide(rng: np.random.Generator, relaxation: float = 0.0, cubic: float = 0.0) -> dict[str, np.ndarray]:
    """Return 20 s at 50 Hz of a carriage on a spring and on LuGre friction, at rest for a moment at each reversal."""
    t = np.arange(0.0, 20.0, 0.02)
    force = 20.0 * np.sin(2.0 * np.pi * t / 4.0 + rng.uniform(0.0, 6.0)) + 8.0 * low_passed(rng, t, 0.5)

    def rates(now, y):
        x, v, z = y
        rate = (v - abs(v) * z) / DISPLACEMENT
        push = np.interp(now, t, force) - 210.0 * x - cubic * x**3 - 7.5 * v - LEVEL * (z + relaxation * rate)
        return [v, push / 2.05, rate]

    y = solve_ivp(rates, (0.0, t[-1]), np.zeros(3), "LSODA", t, rtol=1e-8, atol=1e-10, max_step=0.02).y
    return {
        "time_s": t,
        "force_N": force,
        "position_m": y[0] + 1e-5 * rng.standard_normal(t.size),
        "velocity_m_s": y[1] + 1e-3 * rng.standard_normal(t.size),
    }


def test_friction_that_gives_way_is_taken_into_the_model_and_not_named(tmp_path: Path) -> None:
    study = Study.from_file(written(tmp_path, SLIDE, slide, STUDY + RECORDS, seed=11))
    diagnosis = study.diagnose()
    assert diagnosis.verdict == "nothing missing"
    assert study.stage.effects == ()
    fitted = study.stage.identify.to_dict()
    assert abs(fitted["dry.coulomb"] / LEVEL - 1.0) < 0.05
    assert abs(fitted["dry.x_s"] / DISPLACEMENT - 1.0) < 0.3
    assert any("'dry'" in w and "gives way elastically" in w for w in diagnosis.warnings)


def test_bristles_that_are_damped_make_it_the_law_of_lugre(tmp_path: Path) -> None:
    """A ratio of damping of 0.9 at a natural frequency of 85 rad/s, below the sampling rate.

    At the largest likelihood the displacement is off by 3e-4 of itself, the others by less.
    """
    records = partial(slide, relaxation=0.02)
    study = Study.from_file(written(tmp_path, SLIDE, records, STUDY + RECORDS, seed=12))
    diagnosis = study.diagnose()
    assert diagnosis.verdict == "nothing missing"
    fitted = study.stage.identify.to_dict()
    assert abs(fitted["dry.coulomb"] / LEVEL - 1.0) < 0.01
    assert abs(fitted["dry.x_s"] / DISPLACEMENT - 1.0) < 0.01
    assert abs(fitted["dry.t_s"] / 0.02 - 1.0) < 0.01
    assert any("LuGre's law" in w for w in diagnosis.warnings)


@pytest.mark.parametrize("seed", [14, 16])
def test_it_is_found_beside_an_effect_that_has_hidden_it(tmp_path: Path, seed: int) -> None:
    """However much another linearisation changes the evidence of friction that fades: thousands of nats here."""
    study = Study.from_file(written(tmp_path, SLIDE, partial(slide, cubic=3e4), STUDY + RECORDS, seed=seed))
    search = EvidenceSearch(study)
    start = search.tried.known(study.stage)
    place = next(p for p in study.stage.system.places if "spring" in (p.name, *p.also))
    hardening = Effect.at_place("cubic_stiffness", place, strengths={"stiffness": 3e4})
    [model] = Trials(search.tried).fitted(start, [(Proposal(move="add", effects=(hardening,)), 1.0)])
    assert elastic_friction.with_elastic_friction(search.tried, model)
    fitted = model.stage.identify.to_dict()
    assert fitted["dry.x_s"] == pytest.approx(DISPLACEMENT, rel=0.01)
    assert fitted["dry.coulomb"] == pytest.approx(LEVEL, rel=0.01)
    assert fitted["cubic_stiffness.spring.stiffness"] == pytest.approx(3e4, rel=0.01)
    assert any("Dahl's law" in remark for remark in study.remarks)


def test_it_is_asked_again_beside_an_effect_that_was_missing_when_it_was_found(tmp_path: Path) -> None:
    study = Study.from_file(written(tmp_path, SLIDE, slide, STUDY + RECORDS, seed=11))
    search = EvidenceSearch(study)
    first = search.tried.known(study.stage)
    given = elastic_friction._with_law(study.given, "dry", {"dry.x_s": 1e-3, "dry.t_s": 1e-2})
    study.given = study.problem = given
    elastic = study.fitted("elastic", (), first.stage, first.stage.noise, trial=True)
    records = first.likelihood.noise.records
    noise = SimpleNamespace(model=SimpleNamespace(processes=("a force",)), records=records)
    likelihood = SimpleNamespace(stage=elastic, linearised=first.likelihood.neighbour(elastic).linearised, noise=noise)
    beside: Any = SimpleNamespace(likelihood=likelihood, key=("cubic_stiffness@spring",))
    alone: Any = SimpleNamespace(likelihood=likelihood, key=())
    assert elastic_friction._dry_frictions(search.tried, beside) == []  # it is the law that the user has written
    search.tried.elastic.update({"dry.x_s", "dry.t_s"})
    assert [name for name, _ in elastic_friction._dry_frictions(search.tried, beside)] == ["dry"]
    assert elastic_friction._dry_frictions(search.tried, alone) == []
    undamped = elastic_friction._with_law(given, "dry", {"dry.x_s": 2e-3})
    assert type(undamped.model.components["dry"]) is DahlFriction
    assert [q.name for q in undamped.uncertain if q.name.startswith("dry.")] == ["dry.coulomb", "dry.x_s"]


@pytest.mark.parametrize(("processes", "asked"), [((), []), (("a slow error of an output",), ["dry"])])
def test_it_is_asked_wherever_the_first_model_has_anything_random(tmp_path: Path, processes, asked) -> None:
    study = Study.from_file(written(tmp_path, SLIDE, slide, STUDY + RECORDS, seed=11))
    search = EvidenceSearch(study)
    first = search.tried.known(study.stage).likelihood
    noise = SimpleNamespace(model=SimpleNamespace(processes=processes), records=first.noise.records)
    likelihood = SimpleNamespace(stage=first.stage, linearised=first.linearised, noise=noise)
    model = SimpleNamespace(likelihood=likelihood, key=())
    assert [name for name, _ in elastic_friction._dry_frictions(search.tried, model)] == asked
