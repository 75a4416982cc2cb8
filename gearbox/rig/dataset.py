"""Labelled data sets of healthy and damaged gear stages over speeds and loads: synthetic, and called so."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gearbox.files.errors import GearError
from gearbox.stage.faults import FAULTS, HEALTHY, combined, damageable, fault

if TYPE_CHECKING:
    import pandas

    from gearbox.stage.stage import GearStage

__all__ = ["DatasetPlan", "Sample", "write_dataset"]

README = """Synthetic vibration of a virtual gear stage, made by gearbox.rig.dataset; nothing here was measured.

labels.csv   one row for each recording: file, label, place, severity, tooth, speed, load, seed
plan.json    what was asked for; the same plan gives the same recordings
signals/     one recording each; time in s from the beginning of the record, accelerations in m/s**2, shaft speeds in
             rad/s; the label "healthy" has no fault
"""
SIGNALS = (
    *(f"a_{sensor}_{axis}" for sensor in ("input_seat", "output_seat", "base") for axis in "xyz"),
    "speed_1",
    "speed_2",
)


#: Parameters by full name.
Values = tuple[tuple[str, float], ...]


@dataclass(frozen=True, kw_only=True)
class DatasetPlan:
    """What a data set holds: every label at every severity, speed and load, several times.

    Parameters
    ----------
    labels : sequence of str
        ``"healthy"`` and labels of `gearbox.stage.faults.FAULTS`, with ``@place`` where the kind fits several.
    severities : sequence of float
        For the faults, above zero.
    speeds : sequence of float, r/min
    torques : sequence of float, N m
    repeats : int
        Recordings of each; tooth, phase, position at the start and noise differ.
    duration : float, s
    rate : float, Hz
    noise : float, m/s²
        Standard deviation of white noise on the accelerations.
    seed : int
    format : {"parquet", "csv.gz"}
    parameters : mapping of str to float
        Of the stage, where they differ from the paper's: ``K``, ``C_D``, ``e_F`` or full names, SI.
    rig : int, optional
        Seed of a virtual rig (`gearbox.rig.rig.GearRig`) whose contact parameters the stage has, unless ``parameters``
        give others.
    manufacturing : float
        Factor on the usual errors of manufacturing and assembly of that rig.
    housing : {"flexible", "rigid", "clamped"}

    Raises
    ------
    GearError
        With everything that makes no sense.
    """

    labels: Sequence[str] = (HEALTHY, *FAULTS)
    severities: Sequence[float] = (0.25, 0.5, 1.0)
    speeds: Sequence[float] = (1000.0,)
    torques: Sequence[float] = (150.0,)
    repeats: int = 1
    duration: float = 0.5
    rate: float = 12800.0
    noise: float = 0.05
    seed: int = 0
    format: str = "parquet"
    parameters: Mapping[str, float] = field(default_factory=dict)
    rig: int | None = None
    manufacturing: float = 0.0
    housing: str = "flexible"

    def __post_init__(self) -> None:
        faults = []
        for name in ("labels", "severities", "speeds", "torques"):
            if not list(getattr(self, name)):
                faults.append(f"{name} is empty: give at least one")
        for text in self.labels:
            label, _, where = str(text).partition("@")
            for severity in self.severities if label != HEALTHY else ():
                try:
                    fault(label, where, float(severity))
                except GearError as error:
                    faults += [f"label '{text}': {fault_text}" for fault_text in error.faults]
        if any(not s > 0.0 for s in self.severities):
            faults.append("severities must be above zero; the label 'healthy' has no fault")
        for name in ("duration", "rate"):
            if not getattr(self, name) > 0.0:
                faults.append(f"{name} is {getattr(self, name):g}: give a positive number")
        if any(not np.isfinite(v) for v in (*self.speeds, *self.torques)):
            faults.append("speeds and torques must be finite")
        if self.repeats < 1:
            faults.append(f"repeats is {self.repeats}: give at least 1")
        if not self.noise >= 0.0:
            faults.append(f"noise is {self.noise:g} m/s**2: give zero or more")
        if self.manufacturing and self.rig is None:
            faults.append("errors of manufacturing are drawn for a rig: give its seed as rig, or leave them out")
        if not (np.isfinite(self.manufacturing) and self.manufacturing >= 0.0):
            faults.append(f"manufacturing is {self.manufacturing}: give a number of zero or more")
        if self.rig is not None and (isinstance(self.rig, bool) or not isinstance(self.rig, int) or self.rig < 0):
            faults.append(f"rig is {self.rig!r}: give a seed, a whole number of zero or more")
        if self.housing not in ("flexible", "rigid", "clamped"):
            faults.append(f"housing is '{self.housing}': take flexible, rigid or clamped")
        if self.format not in ("parquet", "csv.gz"):
            faults.append(f"format is '{self.format}': take 'parquet' or 'csv.gz'")
        if faults:
            raise GearError("the plan of a data set", faults)

    def samples(self) -> Iterator[Sample]:
        """Return what is to be recorded, always in the same order."""
        count = 0
        for text in self.labels:
            label, _, where = str(text).partition("@")
            where = where or (FAULTS[label].where[0] if label != HEALTHY else "")
            for severity in self.severities if label != HEALTHY else (0.0,):
                for speed in self.speeds:
                    for torque in self.torques:
                        for _ in range(self.repeats):
                            rng = np.random.default_rng([self.seed, count])
                            yield Sample(
                                name=f"{count:05d}",
                                label=label,
                                where=where,
                                severity=float(severity),
                                speed=float(speed),
                                torque=float(torque),
                                tooth=int(rng.integers(0, 32)),
                                phase=float(rng.uniform(-np.pi, np.pi)),
                                start_angle=float(rng.uniform(0.0, 2.0 * np.pi)),
                                seed=[self.seed, count],
                            )
                            count += 1


@dataclass(frozen=True, kw_only=True)
class Sample:
    """One recording: label, place, severity, speed (r/min), torque (N m), tooth, phase and start angle (rad), seed."""

    name: str
    label: str
    where: str
    severity: float
    speed: float
    torque: float
    tooth: int
    phase: float
    start_angle: float
    seed: Sequence[int] = field(default=(0,))

    def row(self, suffix: str) -> dict[str, Any]:
        """Return the row of labels.csv."""
        known = FAULTS.get(self.label)
        return {
            "file": f"signals/{self.name}.{suffix}",
            "label": self.label,
            "kind": known.kind if known else HEALTHY,
            "where": self.where,
            "severity": self.severity,
            "size": self.severity * known.size if known else 0.0,
            "unit": known.unit if known else "",
            "tooth": self.tooth if known and known.tooth else "",
            "phase_rad": self.phase if known and known.phase else "",
            "speed_rpm": self.speed,
            "torque_Nm": self.torque,
            "start_angle_rad": self.start_angle,
            "seed": " ".join(map(str, self.seed)),
        }


def record(
    stage: GearStage, sample: Sample, plan: DatasetPlan, given: Mapping[str, float] | None = None
) -> pandas.DataFrame:
    """Return one recording, columns ``name [unit]``; ``given`` are the stage's parameters without the fault."""
    import pandas

    values = dict(given or {})
    if sample.label != HEALTHY:
        one = fault(sample.label, sample.where, sample.severity, tooth=sample.tooth, phase=sample.phase)
        for name, value in combined([one]).items():
            # A fault comes on top of an error of the same kind; where it is and which tooth it is are its own.
            values[name] = values.get(name, 0.0) + value if name in one.sizes() else value
    run = stage.simulate(
        sample.speed, sample.torque, plan.duration, rate=plan.rate, parameters=values, angle=sample.start_angle
    )
    rng = np.random.default_rng([*sample.seed, 1])
    columns = {"time [s]": run.times}
    for name in SIGNALS:
        noise = plan.noise if name.startswith("a_") else 0.0
        unit = "m/s**2" if name.startswith("a_") else "rad/s"
        columns[f"{name} [{unit}]"] = run[name] + noise * rng.standard_normal(run.times.size)
    return pandas.DataFrame(columns)


@lru_cache(maxsize=2)
def _stage_of(make: Callable[[], GearStage] | None, rig: tuple[int | None, float, str]) -> tuple[GearStage, Values]:
    """Return the stage and its parameters that differ from the paper's."""
    seed, manufacturing, housing = rig
    if make is not None:
        return damageable(make()), ()
    if seed is None:
        return paper_stage(housing), ()
    from gearbox.rig.rig import GearRig, true_stage

    errors = GearRig(seed=seed, manufacturing=manufacturing, housing=housing)
    stage, values = true_stage(errors, errors.faults_of(()))
    tables = stage.components["mesh"].tables
    whole = damageable(stage)
    whole.components["mesh"].tables.update(tables)
    return whole, tuple(values.items())


def _write_one(make: Callable[[], GearStage] | None, sample: Sample, plan: DatasetPlan, folder: Path) -> str:
    path = folder / "signals" / f"{sample.name}.{plan.format}"
    stage, given = _stage_of(make, (plan.rig, plan.manufacturing, plan.housing))
    frame = record(stage, sample, plan, {**dict(given), **stage.values(**plan.parameters)})
    draft = path.with_name(path.name + ".part")
    if plan.format == "parquet":
        frame.to_parquet(draft, index=False)
    else:
        frame.to_csv(draft, index=False, compression="gzip", float_format="%.9g")
    draft.replace(path)  # a recording is there whole or not at all
    return sample.name


def paper_stage(housing: str = "flexible") -> GearStage:
    """Return the paper's stage with all imperfections of severity zero."""
    from gearbox.stage.stage import GearStage

    return GearStage.paper(housing=housing, imperfect=True, bearing_defects=True)


def write_dataset(
    folder: str | Path,
    plan: DatasetPlan | None = None,
    *,
    make: Callable[[], GearStage] | None = None,
    executor: Executor | None = None,
    progress: Callable[[str], None] | None = None,
) -> pandas.DataFrame:
    """Write a labelled data set and return its labels.

    Recordings that are there already are kept, so that an interrupted run goes on where it stopped; a folder that holds
    another plan is refused.

    Parameters
    ----------
    folder : path
        Made if it is not there.
    plan : DatasetPlan, optional
    make : callable, optional
        Returns a stage of your own, in the place of the plan's rig and housing; at the top of a module, so that worker
        processes can call it.
    executor : Executor, optional
        Where recordings are made; default: here, one after the other.
    progress : callable, optional
        Gets a line of text now and then.

    Raises
    ------
    GearError
        If the folder holds something else.
    """
    import pandas

    plan = plan if plan is not None else DatasetPlan()
    folder = Path(folder)
    content = json.loads(json.dumps(dataclasses.asdict(plan), default=dict))
    plan_file = folder / "plan.json"
    if plan_file.exists() and json.loads(plan_file.read_text(encoding="utf-8")) != content:
        raise GearError(f"the folder '{folder}'", ["it holds a data set of another plan: take an empty folder"])
    if not plan_file.exists() and folder.exists() and any(folder.iterdir()):
        raise GearError(f"the folder '{folder}'", ["it is not empty and holds no data set: take an empty folder"])
    (folder / "signals").mkdir(parents=True, exist_ok=True)
    plan_file.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    (folder / "README.txt").write_text(README, encoding="utf-8")
    samples = list(plan.samples())
    labels = pandas.DataFrame([s.row(plan.format) for s in samples])
    labels.to_csv(folder / "labels.csv", index=False)
    missing = [s for s in samples if not (folder / "signals" / f"{s.name}.{plan.format}").exists()]
    for count, name in enumerate(_made(executor, make, missing, plan, folder), start=1):
        if progress is not None:
            progress(f"recording {name}: {count} of {len(missing)}")
    return labels


def _made(
    executor: Executor | None,
    make: Callable[[], GearStage] | None,
    samples: Sequence[Sample],
    plan: DatasetPlan,
    folder: Path,
) -> Iterable[str]:
    if executor is None:
        return (_write_one(make, s, plan, folder) for s in samples)
    n = len(samples)
    return executor.map(_write_one, [make] * n, samples, [plan] * n, [folder] * n)
