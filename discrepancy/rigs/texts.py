"""Texts written with the recordings of any virtual rig: the study file, and tables for its README."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from discrepancy.rigs.case import Case
    from discrepancy.rigs.recording import Channel, Logger
    from discrepancy.rigs.rig import Rig
    from estimation.fit.calibrate import UncertainParameter

__all__ = ["how_it_ran", "how_it_was_recorded", "list_table", "prior_table", "study"]


def study(
    case: Case,
    machine: str,
    build: str,
    arguments: Sequence[str] = (),
    *,
    start: Sequence[str] = (),
    offsets: Sequence[str] = (),
    extra: Mapping[str, Sequence[str]] | None = None,
) -> str:
    """Return the study file of a case; it depends on nothing that is hidden and on no drawn number.

    Parameters
    ----------
    case : Case
    machine : str
        Such as ``"a linear axis"``.
    build : str
        What ``[model] build`` names.
    arguments : sequence of str
        Lines that follow it.
    start : sequence of str
        Comment beside ``[initial]``.
    offsets : sequence of str
        Outputs whose sensor may have an offset of its own in each record.
    extra : mapping of str to sequence of str
        Further tables: name to lines.
    """
    column = {c.signal: c.column for c in case.channels}
    lines = [
        f"# {machine[0].upper()}{machine[1:]} and recordings of it. The recordings are synthetic, see README.md.",
        "",
        "[model]",
        f'build = "{build}"',
        *arguments,
    ]
    lines += ["", "[uncertain]"]
    for q in case.uncertain:
        low = f", min = {q.min:g}" if np.isfinite(q.min) else ""
        lines.append(f'"{q.name}" = {{ value = {q.value:g}, std = {q.std:g}{low} }}  # {q.unit}')
    lines += ["", "[inputs]", *(f'"{name}" = "{column[name]}"' for name in case.inputs)]
    lines += ["", "[outputs]", *(f'"{name}" = "{column[name]}"' for name in case.outputs)]
    lines += ["", " ".join(("[initial]", *(f" # {text}" for text in start)))]
    lines += [f'"{name}" = 0.0' for name in case.rest]
    lines.append(f"free = [{_quoted(case.free)}]")
    if offsets:
        lines += ["", "[offsets]", f"outputs = [{_quoted(offsets)}]"]
    lines += ["", "[records]", 'time = "time_s"']
    for key, records in (("identify", case.identify), ("validate", case.validate)):
        lines += [f"{key} = [", *(f'    "{r.path.name}",' for r in records), "]"]
    for name, rows in (extra or {}).items():
        lines += ["", f"[{name}]", *rows]
    return "\n".join(lines) + "\n"


def _quoted(names: Sequence[str]) -> str:
    return ", ".join(f'"{name}"' for name in names)


def channel_table(channels: Sequence[Channel]) -> str:
    """Return how each column is recorded, as rows of a table."""
    rows = "\n".join(
        f"| `{c.column}` | {c.signal} | {f'{c.noise:g} {c.unit}' if c.noise else 'none'} | "
        f"{f'{c.resolution:g} {c.measured_unit}' if c.resolution else 'none'} | {'yes' if c.analogue else 'no'} |"
        for c in channels
    )
    head = "| column | model signal | noise (standard deviation) | resolution | anti-alias filter |"
    return f"{head}\n| --- | --- | --- | --- | --- |\n{rows}"


def prior_table(uncertain: Sequence[UncertainParameter]) -> str:
    """Return nominal values and standard deviations of the true ones, as rows of a table."""
    rows = "\n".join(f"| `{u.name}` | {u.value:g} | {u.std:g} | {u.unit or '1'} |" for u in uncertain)
    return f"| parameter | nominal | standard deviation | unit |\n| --- | --- | --- | --- |\n{rows}"


def how_it_ran(rig: Rig, body: str) -> str:
    """Return the items on disturbance and integrator, given the name of the body that is disturbed."""
    d = rig.disturbance
    return f"""\
- A coloured force of {d.size:g} N root mean square disturbs the {body}: in equal parts a
  resonance at {d.frequency:g} Hz (damping ratio {d.damping:g}) and a drift
  with a correlation time of {d.time:g} s.
- It is integrated with {rig.method} at a relative tolerance of {rig.rtol:g}. Dry friction fades at
  {rig.regularisation:g} times the speed at which it does in the model."""


def how_it_was_recorded(logger: Logger, channels: Sequence[Channel]) -> str:
    """Return what the logger does, and how each column is recorded."""
    return f"""\
- The reference reaches its controller every millisecond; the logger writes {logger.rate:g} rows a second.
  Time stamps are even, and the true instants lie about them with a standard deviation of
  {1e6 * logger.jitter:g} µs.

{channel_table(channels)}

The anti-alias filter cuts at {logger.cutoff * logger.rate / 2:g} Hz (−6 dB) with linear phase; the logger
takes its delay out."""


def list_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return what can be hidden, as `discrepancy.rigs.rig.Rig.list` gives it, as lines of text."""
    from discrepancy.rigs.hidden_effects import strengths_of

    table = [("KIND", "WHERE", "USUAL SIZE")]
    for row in rows:
        size = ", ".join(f"{n} {abs(v['value']):.3g} {v['unit']}".rstrip() for n, v in strengths_of(row).items())
        table.append((row["kind"], row["where"], size))
    wide = [max(len(r[k]) for r in table) for k in (0, 1)]
    return "\n".join(f"{kind:<{wide[0]}}  {where:<{wide[1]}}  {size}" for kind, where, size in table)
