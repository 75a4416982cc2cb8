"""The page "Add an effect" is true: its kind is found, fitted, saved, loaded, and shared as a package."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from discrepancy.effects import kinds, laws
from discrepancy.effects.kinds import Kind, KindText, kind_named, register
from discrepancy.effects.laws import Law
from discrepancy.effects.shape_grids import MotionRange
from multibody import Parameter

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "howto" / "add-effect.md"
TEXT = KindText(title="a creep", what="", causes="", confirm="")

LOAD = """
from multibody import Model

system = Model.load("model.json").build()
effect = "exponential_force.spring."
runs = [system.simulate(1.0, parameters={effect + "level": f}, inputs={"force": 5.0}) for f in (0.0, 0.4)]
lean = Model.load("lean.json").build().simulate(1.0, inputs={"force": 5.0})
print(*(float(r["body.position"][-1]) for r in (lean, *runs)))
"""


def run(folder: Path, *command: str, path: Path = ROOT) -> str:
    """Run this Python in a folder, with the packages of another beside those of this checkout."""
    places = os.pathsep.join((str(path), str(ROOT)))
    environment = {**os.environ, "PYTHONPATH": places}
    done = subprocess.run(
        [sys.executable, *command],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.fixture(scope="module")
def page(tmp_path_factory) -> Path:
    """Folder with the files of the page, its recordings made and its steps taken."""
    folder = tmp_path_factory.mktemp("page")
    blocks = re.findall(r"<!-- file: (\S+) -->\n```\w+\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert [n for n, _ in blocks] == ["buffer.py", "slide.py", "record.py", "study.toml", "steps.py", "pyproject.toml"]
    for name, text in blocks:
        (folder / name).write_text(text, encoding="utf-8")
    run(folder, "record.py")
    (folder / "printed.txt").write_text(run(folder, "steps.py"))
    return folder


def test_the_kind_of_the_page_is_added_by_its_name_and_fitted(page):
    printed = (page / "printed.txt").read_text()
    # 1000 samples with 0.1 mm of noise beside an effect that moves the body by 20 mm
    assert "'exponential_force.spring.level': 0.4" in printed
    assert "'exponential_force.spring.reach': 0.1" in printed


def test_a_model_with_the_kind_of_the_page_is_loaded_by_another_program_and_strength_zero_is_absence(page):
    saved = json.loads((page / "model.json").read_text())
    effect = "exponential_force.spring"
    assert saved["components"][effect]["class"] == "buffer.py:ExponentialEffect"
    saved["components"].pop(effect)
    saved["connections"] = [each for each in saved["connections"] if effect not in json.dumps(each)]
    (page / "lean.json").write_text(json.dumps(saved))
    lean, absent, present = map(float, run(page, "-c", LOAD).split())
    assert absent == pytest.approx(lean, abs=1e-12)
    assert present < 0.98 * lean


def installed(page: Path, folder: Path, buffer: str) -> Path:
    """Return a folder with the package of the page as an installer leaves it."""
    offered = tomllib.loads((page / "pyproject.toml").read_text())["project"]
    (folder / "acme_effects").mkdir(parents=True)
    (folder / "acme_effects/__init__.py").touch()
    (folder / "acme_effects/buffer.py").write_text(buffer)
    information = folder / f"{offered['name'].replace('-', '_')}-{offered['version']}.dist-info"
    information.mkdir()
    (information / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {offered['name']}\nVersion: {offered['version']}\n"
    )
    entries = [
        f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in named.items())
        for group, named in offered["entry-points"].items()
    ]
    (information / "entry_points.txt").write_text("\n".join(entries))
    return folder


def test_an_installed_package_adds_its_effects_to_every_catalogue(page, tmp_path):
    site = installed(page, tmp_path / "site", (page / "buffer.py").read_text())
    for name in ("study.toml", "monday.csv", "tuesday.csv"):
        (tmp_path / name).write_bytes((page / name).read_bytes())
    (tmp_path / "slide.py").write_text(re.sub(r"import buffer.*\n", "", (page / "slide.py").read_text()))
    run(tmp_path, str(page / "steps.py"), path=site)
    saved = json.loads((tmp_path / "model.json").read_text())
    offered = "acme_effects.buffer:ExponentialEffect"
    assert saved["components"]["exponential_force.spring"]["class"] == offered
    (tmp_path / "lean.json").write_text(json.dumps(saved))  # the same again: here the file need only be read
    assert len(run(tmp_path, "-c", LOAD, path=site).split()) == 3


def test_a_package_that_fails_is_left_out_with_a_warning(page, tmp_path):
    site = installed(page, tmp_path / "site", "raise RuntimeError('too old')\n")
    script = """
import warnings
from discrepancy.effects.kinds import kinds
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    print("coulomb_friction" in kinds(), *(w.message for w in caught))
"""
    told = run(tmp_path, "-c", script, path=site)
    assert told.startswith("True the effects that the installed package of 'acme_effects.buffer' offers are left out")
    assert "RuntimeError: too old: mend or uninstall it" in told


# -------------------------------------------------------------------- what may be registered


@pytest.fixture
def own_catalogue(monkeypatch):
    """What is registered is gone after the test."""
    monkeypatch.setattr(kinds, "_KINDS", dict(kinds._KINDS))
    monkeypatch.setattr(kinds, "_REGISTERED_BY", dict(kinds._REGISTERED_BY))
    monkeypatch.setattr(laws, "LAWS", dict(laws.LAWS))


class CreepOfATest(Law):
    """F = -stiffness*x, a law like any other."""

    stiffness = Parameter(0.0, "F/X", "force per way")

    def equations(self):
        super().equations()
        self.force = -self.stiffness * (self.a.position - self.b.position)


def creep(name: str, law: str, title: str = "a creep") -> Kind:
    return Kind(name=name, at="connection", law=law, strengths=("stiffness",), text=KindText(title, "", "", ""))


def test_a_file_that_is_loaded_again_registers_again(own_catalogue):
    register(creep("creep_of_a_test", "CreepOfATest"), law=CreepOfATest)
    register(creep("creep_of_a_test", "CreepOfATest", "another title"), law=CreepOfATest)
    assert kind_named("creep_of_a_test").text.title == "another title"


def test_the_name_of_another_files_kind_is_refused(own_catalogue):
    with pytest.raises(ValueError, match="there is already a kind 'coulomb_friction'"):
        register(creep("coulomb_friction", "CreepOfATest"))


def test_a_law_inside_a_function_is_refused_when_it_is_registered(own_catalogue):
    class Hidden(Law):
        stiffness = Parameter(0.0, "F/X", "force per way")

    with pytest.raises(ValueError, match=r"Hidden of .* is not at the top of its file: move it there"):
        register(creep("hidden_of_a_test", "Hidden"), law=Hidden)


def test_a_law_whose_class_would_hide_another_is_refused(own_catalogue, monkeypatch):
    monkeypatch.setattr(sys.modules[__name__], "SecondEffect", int, raising=False)
    second = type("Second", (CreepOfATest,), {"__module__": __name__, "__doc__": "A law."})
    with pytest.raises(ValueError, match="has another 'SecondEffect': rename it, or the law 'Second'"):
        register(creep("second_of_a_test", "Second"), law=second)


def test_the_old_name_of_a_shapes_amplitude_is_understood_with_a_warning():
    kind = Kind(
        name="creep_of_an_older_file",
        at="connection",
        law="Maxwell",
        strengths=("stiffness",),
        text=TEXT,
        shapes=lambda motion: [{"time": 0.1, "secant": 2.0}],
        linear=False,
    )
    with pytest.warns(FutureWarning, match="'secant' of a shape is now called 'amplitude'"):
        shapes = kind.shape_grid(MotionRange(low=-1.0, high=1.0, speed=0.5, turns=False, scale=1e3))
    assert shapes == [{"time": 0.1, "amplitude": 2.0}]
