"""The texts that stand beside recordings of the virtual axis: the study file and the README."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from discrepancy.axis import AxisRig
    from discrepancy.bench import Case

__all__ = ["readme", "study"]


def study(case: Case, coulomb: float | None = None) -> str:
    """Return the study file of a case; it depends on nothing that is hidden and on no drawn number."""
    column = {c.signal: c.column for c in case.channels}
    lines = [
        "# A linear axis and recordings of it. The recordings are synthetic, see README.md.", "", "[model]",
        'build = "axis.py:build"']
    if coulomb is not None:
        lines.append(f"arguments = {{ coulomb = {coulomb} }}")
    lines += ["", "[uncertain]"]
    for each in case.uncertain:
        low = f", min = {each.min:g}" if np.isfinite(each.min) else ""
        lines.append(f'"{each.name}" = {{ value = {each.value:g}, std = {each.std:g}{low} }}  # {each.unit}')
    lines += ["", "[inputs]", *(f'"{name}" = "{column[name]}"' for name in case.inputs)]
    lines += ["", "[outputs]", *(f'"{name}" = "{column[name]}"' for name in case.outputs)]
    lines += ["", "[initial]  # the control has settled before a record begins"]
    lines += [f'"{name}" = 0.0' for name in case.rest]
    lines.append(f"free = [{', '.join(f'{chr(34)}{name}{chr(34)}' for name in case.free)}]")
    lines += ["", "[records]", 'time = "time_s"']
    for key, records in (("identify", case.identify), ("validate", case.validate)):
        lines += [f"{key} = [", *(f'    "{r.path.name}",' for r in records), "]"]
    return "\n".join(lines) + "\n"


def readme(rig: AxisRig, case: Case) -> str:
    """Return the README of a case: that the data are synthetic and how they were made."""
    logger, disturbance = rig.logger, rig.disturbance
    rows = "\n".join(
        f"| `{c.column}` | {c.signal} | {f'{c.noise:g} {c.unit}' if c.noise else 'none'} | "
        f"{c.resolution:g} {c.measured_unit} | {'yes' if c.analogue else 'no'} |" for c in case.channels)
    priors = "\n".join(f"| `{u.name}` | {u.value:g} | {u.std:g} | {u.unit} |" for u in case.uncertain)
    return f"""# Recordings of a virtual axis

**These data are synthetic.** They come from a simulation and not from a machine. They were made by
`vtsdt bench axis` with seed {rig.seed}; the same command gives the same files.

The machine: a servo motor turns a ball screw through an elastic coupling; the screw moves a carriage on a
guide. A position loop around a speed loop, both on the motor's encoder, follows a position reference.

| file | what it is |
| --- | --- |
| `identify_*.csv.gz` | {len(case.identify)} trips for fitting and choosing |
| `validate_*.csv.gz` | {len(case.validate)} trips that are held back |
| `axis.py` | the model under test |
| `study.toml` | the study: `vtsdt diagnose study.toml --out diagnosis` |
| `truth.json` | what was done to the rig, for comparing afterwards; the study does not read it |

Each trip lasts {rig.duration:g} s and starts from home, where the control has already settled. It has
several moves of different length, speed (0.06 to 0.6 m/s) and direction, with holds between them.

## How the rig differs from the model

- It may have effects that the model lacks, or none; `truth.json` says which.
- Its parameters were drawn from the priors in the study:

| parameter | nominal | standard deviation | unit |
| --- | --- | --- | --- |
{priors}

- A coloured force of {disturbance.size:g} N root mean square disturbs the carriage: in equal parts a
  resonance at {disturbance.frequency:g} Hz (damping ratio {disturbance.damping:g}) and a drift
  with a correlation time of {disturbance.time:g} s.
- It is integrated with {rig.method} at a relative tolerance of {rig.rtol:g}. Dry friction fades at
  {rig.regularisation:g} times the speed at which it does in the model.
- The reference reaches its controller every millisecond; the logger writes {logger.rate:g} rows a second.
  Time stamps are even, and the true instants lie about them with a standard deviation of
  {1e6 * logger.jitter:g} µs.

| column | model signal | noise (standard deviation) | resolution | anti-alias filter |
| --- | --- | --- | --- | --- |
{rows}

The anti-alias filter cuts at {logger.cutoff * logger.rate / 2:g} Hz (−6 dB) with linear phase; the logger
takes its delay out.
"""
