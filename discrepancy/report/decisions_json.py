"""Every model that a search tried, and why it was taken or not, as ``decisions.json``."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from discrepancy.conclusion.conclusion import Conclusion
from discrepancy.evidence.policy import POLICY
from discrepancy.report.diagnosis_json import plain
from multibody.base.json_file import write_json_atomically

__all__ = ["save_decisions"]

SCHEMA = 1


def save_decisions(conclusion: Conclusion, path: Path) -> Path:
    """Write the path of a search: the policy, and every model with its log evidence and its outcome.

    Parameters
    ----------
    conclusion : Conclusion
        Of a search.
    path : Path
    """
    content = {
        "schema": SCHEMA,
        "study": conclusion.name,
        "seed": conclusion.seed,
        "policy": dataclasses.asdict(POLICY),
        "taken": sorted(str(e) for e in conclusion.final.effects),
        "models": [m.to_dict() for m in conclusion.models],
    }
    return write_json_atomically(path, plain(content))
