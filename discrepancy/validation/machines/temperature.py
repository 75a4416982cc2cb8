"""What temperature the judged cases ask for: fitted on one half of them, shown on the other."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from discrepancy.evidence.policy import POLICY
from discrepancy.validation.machines.reliability import brier_score_of_models, fitted_temperature, tempered

__all__ = ["temperature_lines", "tried_models"]


@dataclass(frozen=True, kw_only=True, eq=False)
class _TriedModels:
    """The models that the search tried in one case.

    Parameters
    ----------
    log_evidence : ndarray, shape (models,)
        Without prior odds.
    log_prior : ndarray, shape (models,)
        Prior odds.
    true : ndarray of bool, shape (models,)
        Whether a model holds what is hidden, and nothing else.
    """

    log_evidence: NDArray[np.float64]
    log_prior: NDArray[np.float64]
    true: NDArray[np.bool_]


def tried_models(folder: Path) -> _TriedModels | None:
    """Return the models that were tried in the folder of a judged case.

    None where no model can be true (what is hidden is outside the catalogue), where the true one was not tried, or
    where there was no answer.
    """
    try:
        truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
        decisions = json.loads((folder / "out" / "decisions.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    if truth["category"] == "outside":
        return None
    accepted = [e["accept"] for e in truth["effects"]]
    models = [m for m in decisions["models"] if _evidence(m) is not None]
    true = np.array([_is_truth(m["effects"], accepted) for m in models], dtype=bool)
    if not true.any():
        return None
    prior = np.array([m["log_evidence"]["log_prior_odds"] for m in models], dtype=float)
    total = np.array([_evidence(m) for m in models], dtype=float)
    return _TriedModels(log_evidence=total - prior, log_prior=prior, true=true)


def temperature_lines(out: Path, rows: Sequence[Mapping[str, str]]) -> list[str]:
    """Return the page's lines on the temperature (Markdown); none where fewer than two cases can be used.

    Parameters
    ----------
    out : Path
        Folder of the cases.
    rows : sequence of mapping
        Of ``results.csv``.
    """
    found = [tried_models(out / row["case"]) for row in rows]
    cases = [c for c in found if c is not None]
    if len(cases) < 2:
        return []
    first, second = cases[::2], cases[1::2]
    best = fitted_temperature(*_padded(first))
    lines = [
        "## Temperature",
        "",
        f"In {len(cases)} of {len(rows)} cases the true model is among those that were tried. Fitted to every second "
        f"of them, the temperature of the smallest Brier score is {best:.2g}. On the others:",
        "",
        "| temperature | Brier score | truth has a probability above ½ | median of −log p of the truth |",
        "|---|---|---|---|",
    ]
    evidence, true, prior = _padded(second)
    for temperature, note in ((1.0, ""), (POLICY.temperature, ", used"), (best, ", fitted")):
        p = tempered(evidence, temperature, prior)
        truth = np.where(true, p, 0.0).sum(axis=1)
        loss = float(np.median(-np.log(np.maximum(truth, 1e-300))))
        likely = f"{int((truth > 0.5).sum())} of {len(truth)}"
        lines.append(f"| {temperature:.2g}{note} | {brier_score_of_models(p, true):.3f} | {likely} | {loss:.2f} |")
    return lines


def _evidence(model: Mapping[str, Any]) -> float | None:
    """Return the log evidence of a model in decisions.json; None where it could not be fitted."""
    parts = model.get("log_evidence")
    total = parts["total"] if parts else None  # null where a strength would act the other way
    return float(total) if total is not None and math.isfinite(total) else None


def _is_truth(effects: Sequence[str], accepted: Sequence[Sequence[str]]) -> bool:
    """Tell whether the effects are the hidden ones, one for one."""
    return len(effects) == len(accepted) and any(
        all(any(fnmatchcase(name, pattern) for pattern in accept) for name, accept in zip(order, accepted, strict=True))
        for order in itertools.permutations(effects)
    )


def _padded(
    cases: Sequence[_TriedModels],
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
    """Return log evidence, truth and prior as arrays (cases, models); −inf, False and 0 where there is no model."""
    most = max(c.true.size for c in cases)
    evidence, prior = np.full((len(cases), most), -np.inf), np.zeros((len(cases), most))
    true = np.zeros((len(cases), most), dtype=bool)
    for k, case in enumerate(cases):
        n = case.true.size
        evidence[k, :n], prior[k, :n], true[k, :n] = case.log_evidence, case.log_prior, case.true
    return evidence, true, prior
