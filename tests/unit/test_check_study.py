"""``vtsdt check``: a reversed sign, a factor, swapped columns and unexcited parameters are told in those words."""

from __future__ import annotations

import inspect
import json
from pathlib import Path

import numpy as np
import pytest

from discrepancy.problem.problem import read_problem
from discrepancy.questions.plausibility import Check, check_problem
from multibody import Model
from multibody.library import CoulombFriction, ForceSource, Mass, SpringDamper
from vtsdt.cli import main


def build(dry: float = 0.0) -> Model:
    model = Model("two")
    for n, m, k in ((1, 2.0, 150.0), (2, 1.0, 900.0)):
        mass = model.add(f"mass{n}", Mass(m=m))
        spring = model.add(f"spring{n}", SpringDamper(stiffness=k, damping=4.0))
        push = model.add(f"push{n}", ForceSource())
        model.connect(mass.flange, spring.b, push.flange)
        model.connect(spring.a, model.ground)
        friction = model.add(f"friction{n}", CoulombFriction(coulomb=n * dry))
        model.connect(friction.a, mass.flange)
        model.connect(friction.b, model.ground)
        model.input(f"push{n}", push.force)
    return model


@pytest.fixture(scope="module")
def motion() -> np.ndarray:
    """Time, two forces, two positions with noise of their sensors."""
    t = np.arange(2000) * 0.005
    push = np.column_stack([20.0 * np.sin(2.0 * t + 0.1 * t**2), 30.0 * np.sin(5.0 * t - 0.15 * t**2)])
    run = (
        build()
        .build()
        .simulate((0.0, float(t[-1])), inputs={"push1": (t, push[:, 0]), "push2": (t, push[:, 1])}, times=t, rtol=1e-8)
    )
    names = list(run.system.output_names)
    x = run.outputs[:, [names.index("mass1.position"), names.index("mass2.position")]]
    return np.column_stack([t, push, x + 2e-5 * np.random.default_rng(1).standard_normal(x.shape)])


@pytest.fixture(scope="module")
def beside_friction(motion) -> np.ndarray:
    """The same of a machine with dry friction in its springs, which the model lacks."""
    t = motion[:, 0]
    inputs = {"push1": (t, motion[:, 1]), "push2": (t, motion[:, 2])}
    run = build(dry=4.0).build().simulate((0.0, float(t[-1])), inputs=inputs, times=t, rtol=1e-8)
    noise = 2e-5 * np.random.default_rng(2).standard_normal((t.size, 2))
    return np.column_stack([motion[:, :3], run["mass1.position"] + noise[:, 0], run["mass2.position"] + noise[:, 1]])


def study(folder: Path, table: np.ndarray, uncertain: str = '"spring1.stiffness" = { std = 50.0 }') -> Path:
    parts = "CoulombFriction, ForceSource, Mass, SpringDamper"
    head = f"from multibody import Model\nfrom multibody.library import {parts}\n\n\n"
    (folder / "model.py").write_text(head + inspect.getsource(build))
    np.savetxt(folder / "run.csv", table, "%.9g", ",", header="t_s,f1_N,f2_N,x1_m,x2_m", comments="")
    path = folder / "study.toml"
    path.write_text(
        f'[model]\nbuild = "model.py:build"\n[uncertain]\n{uncertain}\n'
        '[inputs]\n"push1" = "f1_N"\n"push2" = "f2_N"\n'
        '[outputs]\n"mass1.position" = "x1_m"\n"mass2.position" = "x2_m"\n'
        '[records]\ntime = "t_s"\nidentify = ["run.csv"]\n'
    )
    return path


def checked(folder: Path, table: np.ndarray, **options: str) -> Check:
    return check_problem(read_problem(study(folder, table, **options)))


def test_a_sound_study_has_no_fault_and_a_picture(tmp_path, motion, capsys):
    path = study(tmp_path, motion)
    assert main(["check", str(path), "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    assert "FAULT" not in told
    assert "'mass1.position' follows the model" in told
    assert (tmp_path / "out" / "check.png").stat().st_size > 10_000


def test_the_check_as_json_is_that_of_the_file_and_nothing_else(tmp_path, motion, capsys):
    path = study(tmp_path, motion[:, [0, 1, 2, 4, 3]])  # swapped columns
    assert main(["check", str(path), "--json", "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().out
    assert told == (tmp_path / "out" / "check.json").read_text(encoding="utf-8")
    found = json.loads(told)
    assert found["schema"] == 1
    assert any("swapped" in text for text in found["faults"])
    assert set(found) == {"schema", "study", "faults", "warnings", "facts"}


def test_the_catalogue_as_json_says_what_is_a_candidate(tmp_path, motion, capsys):
    path = study(tmp_path, motion)
    path.write_text(path.read_text(encoding="utf-8") + '[candidates]\ninclude = ["*@spring1"]\n', encoding="utf-8")
    assert main(["catalogue", str(path), "--names"]) == 0
    names = capsys.readouterr().out.split()
    assert main(["catalogue", str(path), "--json"]) == 0
    effects = json.loads(capsys.readouterr().out)["effects"]
    assert [e["name"] for e in effects if e["candidate"]] == names
    assert 0 < len(names) < len(effects)
    assert all(e["name"] == f"{e['kind']}@{e['where']}" for e in effects)


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (-1.0, "column 'x1_m' is measured with the opposite sign"),
        (1000.0, "column 'x1_m' is measured off by a factor of 1000 "),
    ],
)
def test_a_reversed_sign_and_a_factor_are_told_in_words(tmp_path, motion, factor, words):
    table = motion.copy()
    table[:, 3] *= factor
    found = checked(tmp_path, table)
    assert len(found.faults) == 1
    assert words in found.faults[0]


@pytest.mark.parametrize(
    ("column", "factor", "words"),
    [
        (3, -1.0, "column 'x1_m' is measured with the opposite sign"),
        (3, 1000.0, "column 'x1_m' is measured about 1000 times too large"),
        (3, 1000.0, 'as if its numbers were in mm: say so with unit = "mm" in [outputs]'),
        (4, -1e-3, "column 'x2_m' is measured with the opposite sign and about 1000 times too small"),
    ],
)
def test_sign_and_factor_are_told_though_the_model_lacks_something(tmp_path, beside_friction, column, factor, words):
    """Dry friction that the model lacks takes 10 to 20 % of the motion: no round number, and the same words."""
    table = beside_friction.copy()
    table[:, column] *= factor
    found = checked(tmp_path, table)
    assert len(found.faults) == 1
    assert words in found.faults[0]


def test_one_input_in_another_unit_is_told_once(tmp_path, beside_friction):
    table = beside_friction.copy()
    table[:, 1:3] *= 1e-3
    found = checked(tmp_path, table)
    assert len(found.faults) == 1
    assert "all outputs are measured about 1000 times too large" in found.faults[0]
    assert "('push1', as if in kN or 'push2', as if in kN)" in found.faults[0]


def test_columns_that_may_be_swapped_are_told_though_the_model_lacks_something(tmp_path, beside_friction):
    assert not [w for w in checked(tmp_path, beside_friction).warnings if "swapped" in w]
    found = checked(tmp_path, beside_friction[:, [0, 1, 2, 4, 3]])
    assert [w for w in (*found.faults, *found.warnings) if "'x1_m' and 'x2_m'" in w and "swapped" in w]


def test_swapped_columns_are_told(tmp_path, motion, capsys):
    path = study(tmp_path, motion[:, [0, 1, 2, 4, 3]])
    assert main(["check", str(path), "--quiet"]) == 2
    assert "columns 'x1_m' and 'x2_m' look swapped" in capsys.readouterr().out


def test_a_parameter_that_nothing_excites_is_told(tmp_path, motion):
    table = motion.copy()
    table[:, 2] = 0.0
    table[:, 4] = motion[:, 4] - motion[:, 4] + 2e-5 * np.random.default_rng(2).standard_normal(len(table))
    both = '"spring1.stiffness" = { std = 50.0 }\n"spring2.stiffness" = { std = 50.0 }'
    found = checked(tmp_path, table, uncertain=both)
    assert any("'spring2.stiffness': these records cannot show it" in text for text in found.warnings)
    assert not any("'spring1.stiffness'" in text for text in found.warnings)
    assert any("input 'push2' is constant" in text for text in found.warnings)


OVEN = """
from multibody import Model
from multibody.library import HeatCapacity, HeatSource, TemperatureSource, ThermalConductance


def build(recorded: bool = False):
    model = Model("oven")
    heater, air = model.add("heater", HeatSource()), model.add("air", TemperatureSource())
    body = model.add("body", HeatCapacity(capacity=500.0, recorded_ambient=recorded))
    wall = model.add("wall", ThermalConductance(conductance=2.0))
    model.connect(heater.port, body.port, wall.a)
    model.connect(wall.b, air.port)
    model.input("heater", heater.heat)
    model.input("hall", air.temperature, *([body.surroundings] if recorded else []))
    return model
"""


@pytest.mark.parametrize("recorded", [False, True])
def test_a_recorded_hall_that_no_heat_is_lost_to_is_told(tmp_path, recorded):
    t = np.arange(200) * 5.0
    table = np.column_stack([t, 100.0 + 50.0 * np.sin(t / 90.0), 290.0 + np.sin(t / 200.0), 320.0 + np.sin(t / 90.0)])
    np.savetxt(tmp_path / "run.csv", table, "%.6f", ",", header="t [s],P [W],hall [K],body [K]", comments="")
    (tmp_path / "oven.py").write_text(OVEN)
    (tmp_path / "study.toml").write_text(
        f'[model]\nbuild = "oven.py:build"\narguments = {{ recorded = {str(recorded).lower()} }}\n'
        '[inputs]\nheater = "P [W]"\nhall = "hall [K]"\n[outputs]\n"body.temperature" = "body [K]"\n'
        '[records]\ntime = "t [s]"\nidentify = ["run.csv"]\n'
    )
    facts = check_problem(read_problem(tmp_path / "study.toml")).facts
    told = [text for text in facts if "heat lost at 'body' goes to 293.15 K, though 'hall' is recorded" in text]
    assert len(told) == (0 if recorded else 1)
