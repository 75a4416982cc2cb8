"""The candidates of a stage as the workbench lists them."""

from __future__ import annotations

from typing import Any

from discrepancy.effects.alike import taken_for
from discrepancy.effects.kinds import kind_named, kinds
from discrepancy.study.candidates import Candidates

__all__ = ["candidate_list"]

MOST_CANDIDATES = 20  # that the page lists with a prediction

Entry = dict[str, Any]


def candidate_list(known: Candidates) -> Entry:
    """Return the best candidates with what they are expected to change, and why others were refused.

    Parameters
    ----------
    known : Candidates
    """
    weights = known.weights()
    ties = known.scan.ties
    tied = {} if ties is None or known.scan.best is None else {known.scan.best.name: ties.names}
    rows = []
    for row in known.scan.rows[:MOST_CANDIDATES]:
        kind = kinds()[row.kind]
        falls = {
            name: 100.0 * (1.0 - after / before) if before > 0.0 else 0.0
            for name, (before, after) in known.predict(row.name).rmse().items()
        }
        rows.append(
            {
                "name": row.name,
                "kind": row.kind,
                "title": kind.text.title,
                "where": row.where,
                "weight": weights[row.name],
                "p_value": row.p_value,
                "falls": falls,
                "tied": [n for n in tied.get(row.name, ()) if n != row.name],
                "what": kind.text.what,
                "causes": kind.text.causes,
                "confirm": kind.text.confirm,
                "taken_for": [f"{kind_named(k).text.title} ({where})" for k, where in taken_for(row.kind)],
            }
        )
    refused = [{"name": e.name, "why": why} for e, why in known.refused]
    return {"rows": rows, "nothing": weights[""], "refused": refused, "tell_apart": _tell_apart(rows)}


def _tell_apart(rows: list[Entry]) -> list[str]:
    """Return what would tell the best candidate from those that explain as much; nothing where there are none."""
    if not rows or not rows[0]["tied"]:
        return []
    tied = [r for r in rows if r is rows[0] or r["name"] in rows[0]["tied"]]
    return list(dict.fromkeys(r["confirm"] for r in tied))
