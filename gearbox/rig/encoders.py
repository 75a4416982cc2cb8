"""The virtual gear rig measured by encoders: the recordings that `vtsdt diagnose` of a gear stage is for.

Accelerations at mesh frequency need thousands of steps per turn, and a phase that is not in the recording.  Errors of
teeth and shafts also show in the transmission error over a few turns and in the drive torque: two encoders and a torque
meter, low-passed, a few hundred samples.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.rigs.case import check_folder, write_csv, write_json
from discrepancy.rigs.recording import Channel, Logger
from gearbox.rig.rig import TEETH, GearRig, true_stage
from gearbox.rig.rig import truth as truth_of
from multibody.base.progress import silent

if TYPE_CHECKING:
    from multibody.machine.model import Model

__all__ = ["CONDITIONS", "CYCLES", "build", "make_encoders", "study"]

#: Name, speed (r/min), load (N m), and whether the model may be fitted to it.
CONDITIONS = (
    ("identify_1", 600.0, 100.0, True),
    ("identify_2", 600.0, 150.0, True),
    ("validate_1", 600.0, 120.0, False),
)
RATE, DURATION = 2000.0, 0.4
#: Mesh cycles that pass while the start dies away, whole ones: the teeth stand as the encoders' zero says.
CYCLES = 64
#: Time at both ends that is not compared: the model's start, at rest under the load, has died away by then, s.
EDGE = 0.06
CHANNELS = (
    Channel(signal="speed", column="speed_rpm", unit="rad/s", measured_unit="rpm", exact=True),
    Channel(signal="torque", column="load_torque_Nm", unit="N*m", measured_unit="N*m", exact=True),
    Channel(
        signal="transmission_error",
        column="transmission_error [um]",
        unit="m",
        measured_unit="um",
        noise=3e-7,
        resolution=0.01,
    ),
    Channel(
        signal="drive_torque", column="drive_torque_Nm", unit="N*m", measured_unit="N*m", noise=0.1, resolution=0.01
    ),
)
#: Kinds that encoders and a torque meter at constant speed can show and distinguish.
KINDS = ("eccentricity", "pitch_error", "mesh_stiffness_variation", "misalignment", "profile_error", "unbalance")


def build(speed: float = 600.0, torque: float = 120.0) -> Model:
    """Return the stage under test: shafts that turn and do nothing else, in motion under a load.

    Parameters
    ----------
    speed : float, r/min
    torque : float, N m
    """
    from gearbox.stage.stage import GearStage

    return GearStage.torsional(housing="clamped", imperfect=True).moving(speed, torque)


def study() -> str:
    """Return the study file; it depends on nothing that is hidden."""
    identify, validate = (
        ", ".join(f'"{n}.csv.gz"' for n, _, _, used in CONDITIONS if used is w) for w in (True, False)
    )
    include = ", ".join(f'"{kind}@*"' for kind in KINDS)
    system = build().build(compiled=False)
    initial = "\n".join(f'"{n}" = {float(v):.12g}' for n, v in zip(system.state_names, system.start, strict=True))
    return f"""# A gear stage that turns slowly, measured by encoders. The recordings are synthetic, see README.md.
# vtsdt diagnose study.toml --out diagnosis

[model]
build = "gearbox.rig.encoders:build"
arguments = {{ speed = 600.0, torque = 120.0 }}

[uncertain]  # SI; a force at 1 mm
"mesh.K" = {{ value = 8.6e5, min = 4.3e5, max = 12.9e5 }}
"mesh.C_D" = {{ value = 86e3, min = 86e3, max = 860e3 }}
"mesh.e" = {{ value = 2.0, min = 1.5, max = 2.5 }}

[inputs]
"speed" = "speed_rpm"
"torque" = "load_torque_Nm"

[outputs]
"transmission_error" = "transmission_error [um]"  # of the two encoders, along the line of action
"drive_torque" = "drive_torque_Nm"

[records]
time = "time_s"
low_pass_hz = 100.0  # ten orders of the input shaft; the teeth mesh at 320 Hz
decimate = 5
edge = {EDGE:g}  # the model's start has died away
identify = [{identify}]
validate = [{validate}]

[initial]  # at rest under the load with the speeds of steady running; each kept free would be fitted at great cost
{initial}

[offsets]  # nobody knows where the zeros of two encoders lie to each other
outputs = ["transmission_error"]

[candidates]  # what turns with a shaft or goes with the teeth
include = [{include}]

[study]
residual = "simulation"
max_effects = 4
"""


def _readme(rig: GearRig) -> str:
    rows = "\n".join(
        f"| `{n}.csv.gz` | {rpm:g} | {load:g} | {'fitting' if used else 'held out'} |"
        for n, rpm, load, used in CONDITIONS
    )
    return f"""# Recordings of a virtual gear stage with encoders

**These data are synthetic.** They come from a simulation and not from a machine. They were made by
`vtsdt bench gear --encoders` with seed {rig.seed}; the same command gives the same files.

| file | speed, r/min | load, N·m | for |
| --- | --- | --- | --- |
{rows}

`transmission_error` is what gear 1 has turned ahead of gear 2, along the line of action, from an encoder on each shaft
(noise 0.3 µm, resolution 0.01 µm); `drive_torque` comes from a torque meter (noise 0.1 N·m). {DURATION:g} s at
{RATE:g} Hz; each begins where a tooth of the driving gear touches at the pitch point without load.

The rig's shafts have all six degrees of freedom in their bearings, those of the model under test turn only; contact
stiffness, damping and exponent of the rig are drawn. `truth.json` says what was done to it; the study
(`vtsdt diagnose study.toml --out diagnosis`) does not read it.
"""


def make_encoders(
    out: str | os.PathLike[str],
    hide: Sequence[str] = (),
    *,
    rig: GearRig | None = None,
    progress: Callable[[str], None] = silent,
) -> Path:
    """Write recordings by encoders into a folder, with the study file and the truth; returns the study file.

    Parameters
    ----------
    out : path
        Folder; made if it is not there.
    hide : sequence of str
        ``KIND`` or ``KIND@WHERE``, see :data:`gearbox.rig.hidden.KINDS`.
    rig : GearRig, optional
        Its seed, strength and manufacturing count; its housing stands still.
    progress : callable
        Gets a line of text for each recording.

    Raises
    ------
    BenchError
        With everything that is not possible.
    """
    rig = replace(rig or GearRig(), housing="clamped")
    faults = rig.faults_of(hide)
    folder = check_folder(out)
    stage, values = true_stage(rig, faults)
    logger = Logger(rate=RATE, fine=1, jitter=0.0, cutoff=0.8)
    conditions: dict[str, Any] = {}
    for k, (name, rpm, load, _) in enumerate(CONDITIONS):
        progress(f"recording {k + 1} of {len(CONDITIONS)}: {name}")
        cycle = 60.0 / (rpm * TEETH[0])
        run = stage.simulate(
            rpm,
            load,
            DURATION,
            rate=RATE,
            settle=CYCLES * cycle,
            parameters=values,
            method="DormandPrince54",
            rtol=1e-6,
            atol=1e-9,
        )
        stamps = np.arange(round(DURATION * RATE)) / RATE
        held = {"speed": rpm * np.pi / 30.0, "torque": load}
        seen = {
            c.signal: np.full(stamps.size, held[c.signal]) if c.signal in held else np.asarray(run[c.signal])
            for c in CHANNELS
        }
        rng = rig.stream(700 + k)
        columns = {c.column: logger.read(c, stamps, seen[c.signal], stamps, rng) for c in CHANNELS}
        write_csv(folder / f"{name}.csv.gz", stamps, columns)
        conditions[name] = {"true_rpm": rpm, "true_load_Nm": load}
    path = folder / "study.toml"
    path.write_text(study(), encoding="utf-8")
    (folder / "README.md").write_text(_readme(rig), encoding="utf-8")
    write_json(folder / "truth.json", {**truth_of(rig, [], faults, len(hide)), "conditions": conditions})
    return path
