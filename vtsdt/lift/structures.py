"""Structures of a lift with their numbers of states; ``python -m vtsdt.lift.structures`` prints them."""

from __future__ import annotations

import sys
from dataclasses import dataclass

from vtsdt.lift.lift import Lift

__all__ = ["structure_table", "table_text"]


@dataclass(frozen=True)
class StructureRow:
    """A structure: the call that makes it, its number of states and its inputs."""

    name: str
    made_by: str
    states: int
    inputs: tuple[str, ...]


_CASES: tuple[tuple[str, str, dict[str, bool]], ...] = (
    ("reference model", "reference", {}),
    ("support without inclination", "reference", {"support_inclination": False}),
    ("support fixed", "reference", {"support_inclination": False, "support_vertical": False}),
    ("counterweight vertical only", "reference", {"counterweight_lateral": False, "counterweight_rotation": False}),
    ("cabin vertical only", "reference", {"cabin_lateral": False, "cabin_rotation": False}),
    ("bodies without rotation", "reference", {"cabin_rotation": False, "counterweight_rotation": False}),
    ("bodies without lateral motion", "reference", {"cabin_lateral": False, "counterweight_lateral": False}),
    ("1D model", "one_dimensional", {}),
    ("1D, support without inclination", "one_dimensional", {"support_inclination": False}),
    ("1D, support fixed", "one_dimensional", {"support_inclination": False, "support_vertical": False}),
    ("cabin model", "cabin", {}),
    ("cabin without rotation", "cabin", {"cabin_rotation": False}),
    ("cabin vertical only", "cabin", {"cabin_lateral": False, "cabin_rotation": False}),
)


def structure_table() -> list[StructureRow]:
    """Return the structures with their numbers of states, from the assembled models."""
    rows = []
    for name, method, options in _CASES:
        system = getattr(Lift, method)(**options).system
        arguments = ", ".join(f"{k}={v}" for k, v in options.items())
        rows.append(StructureRow(name, f"Lift.{method}({arguments})", len(system.states), tuple(system.input_names)))
    return rows


def table_text() -> str:
    """Return the structures as a Markdown table."""
    lines = ["| structure | made by | states | inputs |", "|---|---|---|---|"]
    lines += [f"| {r.name} | `{r.made_by}` | {r.states} | {', '.join(r.inputs)} |" for r in structure_table()]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.stdout.write(table_text() + "\n")
