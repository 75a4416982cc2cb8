"""The diagnosis of a lift and that of the same lift, exported as an FMU and read back, side by side.

``python benchmarks/fmu_lift.py [--page docs/benchmarks/fmu-lift.md]``

The lift has 17 states.  Recorded is one with viscous friction between cabin and guides; the model under test lacks it.
"""

from __future__ import annotations

import argparse
import datetime
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import multibody.library as lib
from discrepancy import Study
from multibody import Model
from vtsdt.rig.models import build as lift

__all__ = ["FRICTION", "HIDDEN", "Found", "diagnosed", "write_case"]

FRICTION = 60.0  # N s/m
HIDDEN = "viscous_friction"
NOISE = {"i_q": 0.02, "F_c": 0.3, "cabin.z": 2e-5}  # A, N, m: standard deviations
TRIPS = {"a": (3.0, 1.5), "b": (2.0, 2.0), "c": (2.5, 1.8)}  # speed of the pulley, rad/s, and duration, s
STEP = 0.01  # s
WAYS = {
    "native": ('build = "vtsdt.rig.models:build"', "", "cabin.z"),
    "FMU": (
        'fmu = "lift.fmu"',
        '[connections]\n"cabin" = { force = "F_ext", motion = "cabin.z", rate = "cabin.v_z" }',
        "cabin",
    ),
}
STUDY = """
[model]
{model}
{connections}
[uncertain]
"cabin.mass" = {{ std = 0.4, min = 1.0 }}
[inputs]
"omega_ref" = "omega_ref"
"payload" = "zero"
"tau_L" = "zero"
"friction_c" = "zero"
"friction_cw" = "zero"
[outputs]
{outputs}
[initial]
free = ["cabin.z"]
[records]
time = "t"
identify = ["a.csv", "b.csv"]
validate = ["c.csv"]
[candidates]
include = ["viscous_friction@{place}", "coulomb_friction@{place}", "constant_force@{place}"]
[study]
search = "{search}"
"""


@dataclass(frozen=True)
class Found:
    """What a diagnosis has found, and how long it took, s."""

    conclusion: Any
    seconds: float

    @property
    def effects(self) -> list[str]:
        """Effects by their kinds."""
        return [e.kind for e in self.conclusion.final.effects]

    @property
    def strengths(self) -> dict[str, float]:
        """Strengths of all effects."""
        return {k: float(v) for e in self.conclusion.final.effects for k, v in e.strengths.items()}

    @property
    def errors(self) -> dict[str, float]:
        """Errors of the outputs on the record that took no part."""
        return {name: float(v) for name, v in self.conclusion.final.rmse("validate").items()}


def write_case(folder: Path, fmi_version: str = "3.0") -> None:
    """Write the records of the lift with friction, and the lift without it as an FMU with an input for a force."""
    true = lift()
    friction = true.add("rubbing", lib.ViscousFriction(viscous=FRICTION))
    true.connect(friction.b, "cabin.z_axis")
    true.connect(friction.a, true.ground)
    system, rng = true.build(), np.random.default_rng(3)
    for name, (speed, duration) in TRIPS.items():
        times = np.arange(0.0, duration, STEP)
        reference, zero = -speed * np.sin(np.pi * times / duration) ** 2, np.zeros_like(times)
        inputs = dict.fromkeys(("payload", "tau_L", "friction_c", "friction_cw"), (times, zero))
        run = system.simulate(times[-1], times=times, inputs={**inputs, "omega_ref": (times, reference)})
        columns = [run[output] + noise * rng.standard_normal(times.size) for output, noise in NOISE.items()]
        table = np.column_stack([times, reference, zero, *columns])
        head = ",".join(("t", "omega_ref", "zero", *NOISE))
        np.savetxt(folder / f"{name}.csv", table, "%.9g", ",", header=head, comments="")
    pushed().build().to_fmu(folder / "lift.fmu", fmi_version=fmi_version)


def pushed() -> Model:
    """Return the lift with an input for a force on its cabin."""
    model = lift()
    push = model.add("push", lib.ForceSource())
    model.connect(push.flange, "cabin.z_axis")
    model.input("F_ext", push.force, default=0.0)
    return model


def diagnosed(folder: Path, way: str, search: str = "significance") -> Found:
    """Return the diagnosis of the case in a folder: ``"native"`` or of the ``"FMU"``."""
    model, connections, place = WAYS[way]
    outputs = "\n".join(f'"{name}" = {{ column = "{name}", noise = {noise} }}' for name, noise in NOISE.items())
    path = folder / f"{way}_{search}.toml"
    given = {"model": model, "connections": connections, "outputs": outputs, "place": place, "search": search}
    path.write_text(STUDY.format(**given))
    begun = time.perf_counter()
    conclusion = Study.from_file(path).diagnose()
    return Found(conclusion, time.perf_counter() - begun)


# -------------------------------------------------------------------- as a program

PAGE = """# A lift read back from an FMU

Written on {date} at {commit} by `python benchmarks/fmu_lift.py --page docs/benchmarks/fmu-lift.md`;
{computer}; load of the {cores} cores meanwhile {load}.

A lift with 17 states runs two short trips with viscous friction of {friction:g} N s/m between cabin and guides, and a
third one that takes no part. The model lacks the friction. Its diagnosis is made twice: with the model as it is, and
with the same model exported as an FMU (FMI 3.0, Model Exchange) and read back. Times contain what is compiled, which
the native model may find in the cache.

| search | model | verdict | effect | strength, N s/m | {outputs} | time, s |
|---|---|---|---|---:|{rules}|---:|
{lines}

An FMU is integrated in its own process, where the equations around it are compiled.
"""


def main() -> None:
    """Measure, print, and write the page."""
    sys.path.insert(0, str(Path(__file__).parent))
    from run import machine as computer

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--page", metavar="FILE", type=Path, help="write this page of the docs")
    args = parser.parse_args()
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False).stdout
    lines = []
    with tempfile.TemporaryDirectory() as name:
        write_case(Path(name))
        for search in ("significance", "evidence"):
            for way in WAYS:
                found = diagnosed(Path(name), way, search)
                strengths = ", ".join(f"{v:.4f}" for v in found.strengths.values()) or "–"
                errors = " | ".join(f"{v:.5g}" for v in found.errors.values())
                effects = ", ".join(f"`{e}`" for e in found.effects) or "–"
                lines.append(
                    f"| {search} | {way} | {found.conclusion.verdict} | {effects} | {strengths} | {errors} | "
                    f"{found.seconds:.0f} |"
                )
                print(lines[-1], flush=True)
    if args.page is None:
        return
    units = {"i_q": "A", "F_c": "N", "cabin.z": "m"}
    args.page.write_text(
        PAGE.format(
            date=datetime.date.today().isoformat(),
            commit=commit.strip() or "unknown",
            computer=computer(),
            cores=os.cpu_count(),
            load=f"{os.getloadavg()[0]:.0f}",
            friction=FRICTION,
            outputs=" | ".join(f"error of `{name}`, {units[name]}" for name in NOISE),
            rules="|".join("---:" for _ in NOISE),
            lines="\n".join(lines),
        ),
        encoding="utf-8",
    )


if __name__ == "__main__":
    main()
