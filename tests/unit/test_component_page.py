"""The page "Writing a component": its example does what the page says."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

from multibody import Model
from multibody.library import Mass

PAGE = Path(__file__).resolve().parents[2] / "docs" / "howto" / "add-component.md"


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """The page's two code blocks as one module; its text has to be in a file to be read."""
    first, second = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    file = tmp_path_factory.mktemp("page") / "component_page_example.py"
    file.write_text(f"{first}\n\n{second}", encoding="utf-8")
    spec = importlib.util.spec_from_file_location(file.stem, file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_energy_balance_of_the_example(example):
    run = example.model.build(energy=True).simulate(2.0, rtol=1e-10, atol=1e-12)
    balance = run["energy.stored"] + run["energy.lost"] - run["energy.supplied"]
    assert np.ptp(balance) < 1e-6 * run["energy.lost"][-1]
    assert run["shock.warming"][-1] == pytest.approx(run["energy.lost"][-1] / 500.0, rel=1e-9)


def test_wedge_of_the_page(example):
    model = Model("wedge")
    wedge = model.add("wedge", example.Wedge(slope=0.5))
    model.connect(wedge.a, model.add("push", Mass(m=1.0, velocity=2.0)).flange)
    model.connect(wedge.b, model.add("load", Mass(m=4.0)).flange)
    system = model.build(compiled=False)
    assert system.state_names == ("push.position", "push.velocity")
    y = system.outputs_at(0.0, system.start)
    assert y[system.index("output", "load.velocity")] == 1.0
