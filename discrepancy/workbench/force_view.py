"""What the workbench shows of a missing force: its points over what it may depend on, curves, and simple laws."""

from __future__ import annotations

from typing import Any

import numpy as np

from discrepancy.questions.simple_laws import law_values
from discrepancy.questions.unknown_force import UnknownForce
from discrepancy.workbench.views import MOST_POINTS
from multibody.base.quantity_text import unit_text

__all__ = ["force_view"]

LAW_POINTS = 200  # of a law's line

Entry = dict[str, Any]


def force_view(force: UnknownForce) -> Entry:
    """Return what is known of a missing force as lists of numbers.

    Parameters
    ----------
    force : UnknownForce

    Returns
    -------
    dict
        ``where``, ``unit``, ``sentence``, ``determined`` (share of its variance), and ``over``, the best first: each
        with ``regressor``, ``unit``, ``parity``, ``explained``, ``p``, ``looks_like``, points ``x`` and ``y``, the
        ``curve`` (``x``, ``y``, ``std``) and the ``laws`` that were fitted over it (``name``, ``formula``, ``error``
        relative to the curve's, ``x``, ``y``).
    """
    e = force.estimate
    entries = []
    report = force.report
    for k, explanation in enumerate(report.explanations if report is not None else ()):
        x = e.direction if explanation.regressor == "direction" else e.motion[explanation.regressor]
        curve = explanation.curve
        if curve.period is not None:
            x = curve.grid[0] + np.mod(x - curve.grid[0], curve.period)
        turned = e.direction if explanation.parity == "odd" else np.ones_like(x)
        step = max(1, x.size // MOST_POINTS)
        best = report is not None and report.best is not None and k == 0
        entries.append(
            {
                "regressor": explanation.regressor,
                "unit": unit_text(curve.unit),
                "parity": explanation.parity,
                "explained": explanation.explained,
                "p": explanation.p,
                "looks_like": {n: share for n, share in explanation.aliases.items() if share > 0.5},
                "x": x[::step].tolist(),
                "y": (turned * e.force)[::step].tolist(),
                "curve": {"x": curve.grid.tolist(), "y": curve.value.tolist(), "std": curve.std.tolist()},
                "laws": _laws(force, x) if best else [],
            }
        )
    return {
        "where": e.where,
        "unit": unit_text(e.unit),
        "sentence": force.sentence,
        "determined": e.known,
        "over": entries,
    }


def _laws(force: UnknownForce, x: np.ndarray) -> list[Entry]:
    line = np.linspace(float(np.min(x)), float(np.max(x)), LAW_POINTS)
    return [
        {
            "name": law.name,
            "formula": law.formula,
            "parameters": law.parameters,
            "error": law.error / max(law.curve_error, 1e-300),
            "x": line.tolist(),
            "y": law_values(law, line).tolist(),
        }
        for law in force.laws
    ]
