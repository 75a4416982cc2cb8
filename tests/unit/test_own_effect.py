"""The page "Add an effect" is true: its code registers a kind that the search offers and a machine can carry."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from discrepancy.effects.kinds import Kind, KindText
from discrepancy.effects.shape_grids import MotionRange

PAGE = Path(__file__).parents[2] / "docs" / "howto" / "add-effect.md"

MACHINE = """
import math

{example}

from discrepancy import Effect
from discrepancy.effects.catalogue import catalogue
from multibody import Model
from multibody.library import ForceSource, Mass, ViscousFriction

model = Model("slide")
body = model.add("body", Mass(m=2.0))
guide = model.add("guide", ViscousFriction(viscous=3.0))
push = model.add("push", ForceSource())
model.connect(guide.a, model.ground)
model.connect(guide.b, body.flange)
model.connect(push.flange, body.flange)
model.input("force", push.force)
system = model.build(probes=True)
entry = next(e for e in catalogue(system, (), ()) if e.kind.name == "exponential_force")
absent = Effect.at_place("exponential_force", entry.place, strengths={{"level": 0.0}}, shape={{"reach": 0.1}})
present = Effect.at_place("exponential_force", entry.place, strengths={{"level": 1.0}}, shape={{"reach": 0.1}})
models = (model, absent.added_to(model), present.added_to(model))
runs = [m.build().simulate(1.0, inputs={{"force": 5.0}}) for m in models]
way = [float(r["body.position"][-1]) for r in runs]
assert abs(way[0] - way[1]) < 1e-12, way
assert way[2] < 0.9 * way[0], way
"""


def test_the_kind_of_the_page_is_offered_and_strength_zero_is_absence(tmp_path):
    example = re.search(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)[1]
    script = tmp_path / "own_effect.py"
    script.write_text(MACHINE.format(example=example))
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr[-2000:]


def test_the_old_name_of_a_shapes_amplitude_is_understood_with_a_warning():
    text = KindText(title="a creep", what="", causes="", confirm="")
    kind = Kind(
        name="creep_of_an_older_file",
        at="connection",
        law="Maxwell",
        strengths=("stiffness",),
        text=text,
        shapes=lambda motion: [{"time": 0.1, "secant": 2.0}],
        linear=False,
    )
    with pytest.warns(FutureWarning, match="'secant' of a shape is now called 'amplitude'"):
        shapes = kind.shape_grid(MotionRange(low=-1.0, high=1.0, speed=0.5, turns=False, scale=1e3))
    assert shapes == [{"time": 0.1, "amplitude": 2.0}]
