"""A chain of masses of any size and a recording of it: the cases of the scale page, from one set of numbers each.

The masses stand on springs, dampers and guides in a row; the first is pushed by a recorded force.  The recording is the
model's own simulation with dry friction in the first guide, which the study does not know, and white noise on top.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

__all__ = ["Case", "write"]

STEP = 2e-3  # s between rows: about fifty in a period of the fastest mode of a chain
NOISE = 0.01  # of an output's standard deviation

MODEL = '''"""Masses in a row, each on a guide, coupled by springs and dampers; the first is pushed."""

import multibody.library as lib
from multibody.machine.model import Model


def build(masses: int = 2, dry: float = 0.0, links: int = 0) -> Model:
    """Return the chain; ``dry`` is a friction in the first guide, N, links are weak springs in parallel."""
    m = Model("chain")
    push = m.add("push", lib.ForceSource())
    m.input("force", push.force)
    first = before = None
    flanges = []
    for k in range(masses):
        mass = m.add(f"mass_{k}", lib.Mass(m=1.0 + 0.01 * k))
        guide = m.add(f"guide_{k}", lib.ViscousFriction(viscous=2.0))
        sensor = m.add(f"position_{k}", lib.PositionSensor())
        speed = m.add(f"speed_{k}", lib.VelocitySensor())
        spring = m.add(f"spring_{k}", lib.SpringDamper(stiffness=400.0, damping=0.4))
        m.connect(mass.flange, guide.b, sensor.flange, speed.flange, spring.b)
        m.connect(guide.a, m.ground)
        m.connect(spring.a, m.ground if before is None else before.flange)
        m.output(f"x_{k}", sensor.position)
        m.output(f"v_{k}", speed.velocity)
        first, before = first or mass, mass
        flanges.append(mass.flange)
    apart = [(a, b) for a in range(masses) for b in range(a + 2, masses)]
    for a, b in apart[:links]:
        link = m.add(f"link_{a}_{b}", lib.SpringDamper(stiffness=1.0, damping=0.01))
        m.connect(link.a, flanges[a])
        m.connect(link.b, flanges[b])
    m.connect(push.flange, first.flange)
    if dry > 0.0:
        rub = m.add("rub", lib.CoulombFriction(coulomb=dry, v_s=5e-3))
        m.connect(rub.b, first.flange)
        m.connect(rub.a, m.ground)
    return m
'''


@dataclass(frozen=True, kw_only=True)
class Case:
    """One size of a study.

    Parameters
    ----------
    masses, outputs : int
        Outputs: at most two for each mass, positions first.
    rows : int
        Of each record.
    records : int
        To fit; one more is held out.
    include : tuple of str
        Patterns of candidates.
    links : int
        Weak springs between masses that are not neighbours: more candidates without more states.
    """

    masses: int = 1
    outputs: int = 1
    rows: int = 2000
    records: int = 1
    include: tuple[str, ...] = ("*",)
    links: int = 0


def write(case: Case, folder: Path) -> Path:
    """Write model, recordings and study of a case, and return the study's path."""
    import pandas
    from scipy.signal import butter, sosfilt

    from multibody.inputs.table import InputTable
    from multibody.system.simulate import simulate

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "chain.py").write_text(MODEL, encoding="utf-8")
    space: dict[str, object] = {}
    exec(compile(MODEL, "chain.py", "exec"), space)
    system = space["build"](case.masses, 1.5, case.links).build()  # type: ignore[operator]
    names = [f"x_{k}" for k in range(case.masses)] + [f"v_{k}" for k in range(case.masses)]
    names = names[: case.outputs]
    rng = np.random.default_rng(1)
    time = STEP * np.arange(case.rows)
    low = butter(2, 4.0, fs=1.0 / STEP, output="sos")
    for k in range(case.records + 1):
        force = 60.0 * sosfilt(low, rng.standard_normal(case.rows))
        run = simulate(
            system, (0.0, float(time[-1])), inputs=InputTable.from_columns(time, {"force": force}), times=time
        )
        columns = {"time": time, "force": force}
        for name in names:
            y = run.outputs[:, system.output_names.index(name)]
            columns[name] = y + NOISE * float(np.std(y)) * rng.standard_normal(case.rows)
        pandas.DataFrame(columns).to_parquet(folder / f"record_{k}.parquet")
    files = ", ".join(f'"record_{k}.parquet"' for k in range(case.records))
    study = [
        "[model]",
        'build = "chain.py:build"',
        f"arguments = {{ masses = {case.masses}, links = {case.links} }}",
        "[uncertain]",
        *(f'"guide_{k}.viscous" = {{ std = 1.0, min = 0.0 }}' for k in range(min(case.masses, 4))),
        "[inputs]",
        'force = "force"',
        "[outputs]",
        *(f'{name} = {{ column = "{name}" }}' for name in names),
        "[records]",
        'time = "time"',
        f"identify = [{files}]",
        f'validate = ["record_{case.records}.parquet"]',
        "[candidates]",
        f"include = [{', '.join(repr(p) for p in case.include)}]",
    ]
    path = folder / "study.toml"
    path.write_text("\n".join(study) + "\n", encoding="utf-8")
    return path
