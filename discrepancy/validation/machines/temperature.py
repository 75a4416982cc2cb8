"""What temperature the judged cases ask for: fitted on one half of them, shown on the other."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from discrepancy.evidence.policy import POLICY
from discrepancy.validation.machines.evidence_of_truth import is_truth, log_evidence_of
from discrepancy.validation.machines.reliability import brier_score_of_models, fitted_temperature, tempered

__all__ = ["temperature_lines", "tried_models"]


@dataclass(frozen=True, kw_only=True, eq=False)
class _TriedModels:
    """The models that the search tried in one case.

    Parameters
    ----------
    log_evidence : ndarray, shape (models,)
        Without prior odds, and without what is overstated.
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
    evidence = {k: e for k, m in enumerate(decisions["models"]) if (e := log_evidence_of(m, as_held=True)) is not None}
    models = [decisions["models"][k] for k in evidence]
    true = np.array([is_truth(m["effects"], accepted) for m in models], dtype=bool)
    if not true.any():
        return None
    prior = np.array([m["log_evidence"]["log_prior_odds"] for m in models], dtype=float)
    return _TriedModels(log_evidence=np.array(list(evidence.values()), dtype=float), log_prior=prior, true=true)


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
