"""Energy of the machines that ``vtsdt init`` writes: what is stored, lost and supplied is all of it."""

from __future__ import annotations

import importlib.util
import sys

import numpy as np
import pytest

from discrepancy.starters.kinds import KINDS

#: Amplitudes that each machine takes, by the unit of its input; 1 else.
SIZES = {"m": 0.05, "m**3/s": 1e-5, "rad/s": 10.0}


def started(kind, folder):
    """Return the model that is written for a kind."""
    path = folder / f"started_{kind.name.replace('-', '_')}.py"
    path.write_text(kind.model_text(kind.drives[0]), encoding="utf-8")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module.build()


@pytest.mark.parametrize("kind", [KINDS[n] for n in ("quarter-car", "tanks")], ids=lambda k: k.name)
def test_components_of_a_started_machine_of_its_own_keep_account_of_energy(kind, tmp_path):
    # only these bring components of their own; those of the library are in test_library
    assert sum(bool(k.classes) for k in KINDS.values()) == 2
    system = started(kind, tmp_path).build(energy=True)
    t = np.linspace(0.0, 2.0, 2001)
    inputs = {q.name: (t, q.value + SIZES.get(q.unit, 1.0) * np.sin(2.0 * np.pi * t) ** 3) for q in system.inputs}
    run = system.simulate(2.0, inputs=inputs, rtol=1e-10, atol=1e-12)
    stored, lost, supplied = (run[f"energy.{n}"] - run[f"energy.{n}"][0] for n in ("stored", "lost", "supplied"))
    assert np.max(np.abs(stored + lost - supplied)) < 1e-8 * np.max(np.abs(supplied))
