"""The virtual gear rig measured by accelerometers: recordings, study file and README for `vtsdt update-gearbox`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from discrepancy.rigs.case import check_folder, write_csv, write_json
from gearbox.rig.rig import GearRig, record, truth
from multibody.base.progress import Progress, silent

__all__ = ["PARAMETERS", "SENSOR", "make_gear", "readme", "study"]

#: Name, start (Table 2), range (Table 3) and unit, SI but for K, which is a force at a penetration of 1 mm.
PARAMETERS = (
    ("K", 8.6e5, 4.3e5, 12.9e5, "N at 1 mm"),
    ("C_D", 86e3, 86e3, 860e3, "N*s/m"),
    ("e_F", 2.0, 1.5, 2.5, ""),
    ("D_P", 1.0e-4, 0.5e-4, 1.5e-4, "m"),
    ("E", 210e9, 179e9, 242e9, "Pa"),
    ("rho", 7800.0, 6600.0, 9000.0, "kg/m**3"),
)


#: Seat and axis whose similarity sees the contact parameters, by housing (see the how-to page).
SENSOR = {"flexible": "a_output_seat_z", "rigid": "a_input_seat_x", "clamped": "a_input_seat_x"}


def study(rig: GearRig) -> str:
    """Return the study file; it depends on nothing that is hidden and on no drawn number."""
    arguments = "" if rig.housing == "flexible" else f'arguments = {{ housing = "{rig.housing}" }}\n'
    outputs = "\n".join(f'"{c.signal}" = "{c.column}"' for c in rig.channels if c.signal.startswith("a_"))
    identify, validate = (
        "".join(f'    "{name}.csv.gz",\n' for name, _, _, used in rig.conditions if used is wanted)
        for wanted in (True, False)
    )
    parameters = "\n".join(
        f'{name} = {{ start = {start:g}, min = {low:g}, max = {high:g}, unit = "{unit}" }}'
        for name, start, low, high, unit in PARAMETERS
    )
    return f"""# A gear stage and recordings of it. The recordings are synthetic, see README.md.
# vtsdt update-gearbox study.toml --out updating

[model]
build = "gearbox.stage:build"
{arguments}
[uncertain]  # for vtsdt diagnose and vtsdt compare; SI
"mesh.K" = {{ value = 8.6e5, min = 4.3e5, max = 12.9e5 }}
"mesh.C_D" = {{ value = 86e3, min = 86e3, max = 860e3 }}
"mesh.e" = {{ value = 2.0, min = 1.5, max = 2.5 }}

[inputs]
"speed" = "speed_rpm"
"torque" = "load_torque_Nm"

[outputs]
{outputs}

[records]
time = "time_s"
identify = [
{identify}]
validate = [
{validate}]

[updating]
# Compared by cosine similarity, at the first recording under identify.  Not every sensor will do: where one mesh line
# outweighs the others in the band, a free lag makes the cosine nearly one whatever the parameters are.
sensor = "{SENSOR[rig.housing]}"
# Compared by amplitudes and phases, over all recordings under identify.
sensors = ["a_input_seat_y", "a_output_seat_y", "a_output_seat_z", "a_base_z"]
driving_teeth = 32
speed = "speed"
load = "torque"
objective = "similarity"       # or "difference", "amplitudes"
lag = "best"                   # or "mesh", "held", "none"
band = [300.0, 1200.0]         # Hz
points = [25, 30, 35, 40, 45, 50]
test = 20
seed = 0

[updating.parameters]          # Tables 2 and 3 of the gearbox paper
{parameters}
"""


def readme(rig: GearRig) -> str:
    """Return the README: that the data are synthetic, and how they were made."""
    rows = "\n".join(
        f"| `{name}.csv.gz` | {rpm:g} | {torque:g} | {'updating' if used else 'held out'} |"
        for name, rpm, torque, used in rig.conditions
    )
    options = f" --manufacturing {rig.manufacturing:g}" if rig.manufacturing else ""
    return f"""# Recordings of a virtual gear stage

**These data are synthetic.** They come from a simulation and not from a machine. They were made by
`vtsdt bench gear` with seed {rig.seed}; the same command gives the same files.

The machine: the single-stage helical gearbox (32/44 teeth) of "Digital twin-assisted gearbox dynamic model updating
toward fault diagnosis", whose shafts, bearings, housing and drive are this project's own choice. A motor holds the
speed of the input shaft, a brake loads the output shaft, three triaxial accelerometers sit on the bearing seats and on
the base.

| file | speed reported, r/min | load, N·m | for |
| --- | --- | --- | --- |
{rows}

Other files: `study.toml` (the study: `vtsdt update-gearbox study.toml --out updating`) and `truth.json` (what was done
to the rig, for comparing afterwards; the study does not read it). Each recording lasts {rig.duration:g} s at
{rig.logger.rate:g} Hz.

## How the rig differs from the model under test

- Its contact stiffness, damping and force exponent are drawn within the ranges that the study allows.
- It may have effects that the model lacks, or none, and errors of manufacturing and assembly, or none ({
        f"here {rig.manufacturing:g} times the usual" if rig.manufacturing else "here none"
    });
  `truth.json` says which. The options were `--seed {rig.seed}{options}` and perhaps `--hide`.
- Every recording begins at another angle of the shafts; the true speed is up to 0.03 % off the reported one and
  drifts slowly by {100 * rig.wander:g} %; the true load is up to 0.3 % off the reported one.
- Each accelerometer has a mounting resonance between 5 and 8 kHz, a gain error of up to 6 %, a delay of 10 to 40 µs,
  noise of {rig.noise:g} m/s² and a resolution of 0.002 m/s²; an anti-alias filter cuts at
  {rig.logger.cutoff * rig.logger.rate / 2:g} Hz.
- It is integrated at tighter tolerances.
"""


def make_gear(
    out: str | os.PathLike[str], hide: Sequence[str] = (), *, rig: GearRig | None = None, progress: Progress = silent
) -> Path:
    """Write recordings of the virtual gear rig into a folder, with the study file and the truth.

    Parameters
    ----------
    out : path
        Folder; made if it is not there.
    hide : sequence of str
        ``KIND`` or ``KIND@WHERE``, see :data:`gearbox.rig.hidden.KINDS`.
    rig : GearRig, optional
    progress : callable
        Gets a line of text for each recording.

    Returns
    -------
    Path
        The study file.

    Raises
    ------
    BenchError
        With everything that is not possible.
    """
    rig = rig or GearRig()
    rig.faults_of(hide)
    if Path(out).is_file():
        check_folder(out)
    recordings, faults = record(rig, hide, progress)
    folder = check_folder(out)
    for recording in recordings:
        progress(f"writing {recording.name}")
        write_csv(folder / f"{recording.name}.csv.gz", recording.stamps, recording.columns)
    path = folder / "study.toml"
    path.write_text(study(rig), encoding="utf-8")
    (folder / "README.md").write_text(readme(rig), encoding="utf-8")
    write_json(folder / "truth.json", truth(rig, recordings, faults, len(hide)))
    return path
