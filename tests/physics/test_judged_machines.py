"""The plain equations of the machines on which the search is judged, against their baseline models."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from discrepancy.validation.machines.case import NATS
from discrepancy.validation.machines.fleet import NAMES, machine_named
from discrepancy.validation.machines.machine import Machine
from discrepancy.validation.machines.simulate import simulate

ROWS = 120
#: Root mean square difference over the sensor's noise that may stand between the equations and the baseline model where
#: dry friction sticks: presliding, rest.  Where it is above one the study has more than noise to explain.
STICKING = {"drive_train": 1.5, "linear_motor": 1.5, "valve": 1.5, "flywheel": 1.0}
#: Nats that the difference may be worth elsewhere, in all records together that effects are looked for in, such as that
#: of a sampled controller's hold: as much as the smallest effect that is hidden.
HARDLY_VISIBLE = min(NATS)


def module_of(machine: Machine, folder: Path) -> ModuleType:
    """The baseline model's file, imported."""
    file = folder / f"{machine.name}_baseline.py"
    file.write_text(machine.model)
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[file.stem] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", NAMES)
def test_the_baseline_model_is_the_machine_without_effects(name: str, tmp_path: Path) -> None:
    whole = machine_named(name)
    machine = replace(whole, rows=ROWS) if name in STICKING else whole
    rng = np.random.default_rng(1)
    true = {p.name: p.stated + rng.uniform(-1.0, 1.0) * p.std for p in machine.parameters}
    drives = machine.excite(rng, machine.times)
    start = {s.name: s.std for s in machine.starts}
    truth = simulate(machine, {**true, **start}, {k: v[:, None] for k, v in drives.items()})
    system = (
        module_of(machine, tmp_path).build().build(compiled=False)
    )  # in plain Python: faster than compiling thirteen models
    own = dict(zip(system.state_names, system.start, strict=True))
    run = system.simulate(
        (0.0, machine.times[-1]),
        inputs={d.input: (machine.times, drives[d.name]) for d in machine.drives},
        parameters={p.path: true[p.name] for p in machine.parameters},
        initial={s.state: own[s.state] + start[s.name] for s in machine.starts},
        times=machine.times,
        method="LSODA",
        interpolation="hold" if machine.drives[0].hold else "linear",
    )
    square = {c.name: float(np.mean((run[c.output] - truth[c.name][:, 0]) ** 2)) for c in machine.channels}
    over_noise = {c.name: square[c.name] / c.deviation**2 for c in machine.channels}
    if name in STICKING:
        assert max(over_noise.values()) < STICKING[name] ** 2, over_noise
    else:
        assert 0.5 * machine.identify * machine.rows * sum(over_noise.values()) < HARDLY_VISIBLE, over_noise
