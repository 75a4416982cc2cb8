"""The page of the catalogue of effects, written from the kinds themselves."""

from __future__ import annotations

import re
from collections.abc import Callable

from discrepancy.effects.alike import taken_for
from discrepancy.effects.built_in_kinds import BUILT_IN_KINDS
from discrepancy.effects.kind_picture import has_picture, kind_picture
from discrepancy.effects.kinds import SHIPPED, Kind, kinds
from discrepancy.effects.law_in_words import law_of
from discrepancy.effects.stated_values import STATED_KINDS

PICTURES = "images/catalogue"

INTRO = """# Catalogue of effects

What a diagnosis asks for, written from the catalogue itself. A kind is a component with a strength, and strength zero
is exactly absence. It is asked only where the machine has a place for it. A force that none of them describes is
searched for as a curve ([unknown force](../method/unknown-force.md)). Effects of gear stages are on a page of their own
([faults of gears](gear-faults.md)); yours are a file away ([add an effect](../howto/add-effect.md)).

In the laws, $x$, $v$ and $t$ are position, speed and time, the first side against the second; the force acts on the
first side ([sign conventions](sign-conventions.md)). In the pictures the dashed line is the machine without the effect.
"""

GROUPS: dict[str, tuple[str, Callable[[Kind], bool]]] = {
    "Between two parts that move": (
        "Asked at every connection, and at every inertia against the ground; each for sliding and for turning.",
        lambda k: k.at == "connection",
    ),
    "Sensors": ("Asked at every measured output.", lambda k: k.at == "sensor"),
    "Inputs and controllers": (
        "Asked at every recorded input, and at what control gives to the machine.",
        lambda k: k.at in ("input", "signal"),
    ),
    "Inside a part": (
        "Asked at every part of these classes whose strength is zero.",
        lambda k: k.at == "parameter" and not k.stated,
    ),
    "Values that are stated wrongly": (
        "Asked at every part of these classes whose value calibration does not move; absence is the stated value.",
        lambda k: k.stated,
    ),
}
NEEDS = {
    "stiffness": "a spring of its own",
    "load": "a part that brings a known force there",
    "ground": "an inertia against the ground",
    "travel": "a travel, not the stretch of a spring between two bodies",
    "dry friction": "a dry friction in the model",
    "viscous friction": "a friction per speed in the model",
}


def catalogue_page() -> str:
    """Return the page."""
    parts = [INTRO]
    for title, (what, belongs) in GROUPS.items():
        parts += [f"## {title}", what]
        parts += [_entry(kind) for kind in shown() if belongs(kind)]
    return "\n\n".join(parts) + "\n"


def shown() -> list[Kind]:
    """Return the kinds that the page shows: those of every machine."""
    names = [*SHIPPED, *(kind.name for kind in (*BUILT_IN_KINDS, *STATED_KINDS))]
    return [kinds()[name] for name in names if has_picture(kinds()[name])]


def pictures() -> dict[str, str]:
    """Return the picture of every kind as SVG, by its path in the docs."""
    return {f"{PICTURES}/{kind.name}.svg": kind_picture(kind) for kind in shown()}


def _entry(kind: Kind) -> str:
    text = kind.text
    lines = [
        f"### {text.title[:1].upper()}{text.title[1:]}",
        f"![{text.title}](../{PICTURES}/{kind.name}.svg){{ width=420 }}",
        f"`{kind.name}`. {text.what}",
        f"- **Law**: {law_of(kind)}",
        f"- **Strength**: {', '.join(f'`{s}`' for s in kind.strengths)}{_fitted(kind)}",
    ]
    if where := _asked(kind):
        lines.append(f"- **Asked where there is** {where}")
    if any(form.at == "transmission" for form in kind.forms):
        lines.append("- **Also** in the place of a rigid `Gear` or `Rack` ([law](transmissions.md#slip))")
    lines += [f"- **Causes**: {text.causes}", f"- **A record that shows it**: {text.confirm}"]
    if alike := taken_for(kind.name):
        conditions: dict[str, list[str]] = {}
        for other, where in alike:
            conditions.setdefault(where, []).append(f"[{_title(other)}](#{_anchor(other)})")
        told = "; ".join(f"{', '.join(names)} ({where})" for where, names in conditions.items())
        lines.append(f"- **Taken for**: {told}")
    head, items = lines[:3], lines[3:]
    return "\n\n".join([*head, "\n".join(items)])


def _fitted(kind: Kind) -> str:
    return f"; then fitted: {', '.join(f'`{s}`' for s in kind.free_shapes)}" if kind.free_shapes else ""


def _asked(kind: Kind) -> str:
    if kind.at == "parameter":
        classes = kind.component if isinstance(kind.component, tuple) else (kind.component,)
        return " or ".join(f"a `{cls.__name__}`" for cls in classes if cls is not None)
    found = [NEEDS[kind.needs]] if kind.needs else []
    found += ["a temperature in the model"] if kind.signal == "temperature" else []
    found += [{True: "a spring", False: "no spring"}[kind.elastic]] if kind.elastic is not None and not found else []
    return " and ".join(found)


def _title(name: str) -> str:
    return kinds()[name].text.title


def _anchor(name: str) -> str:
    """Return the anchor that the site gives to a heading."""
    return re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", _title(name)).strip().lower())
