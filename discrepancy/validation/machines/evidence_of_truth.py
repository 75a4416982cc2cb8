"""By how many nats the records of a judged case are for what is hidden, once the noise is fitted as well.

The grade of a case takes the disturbance for known.  A search does not know it, and a random force that varies slowly
does much of what a constant force, say, does; so less may be left of a thousand nats than of a hundred.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

__all__ = ["FITTED_ALONE", "evidence_of_truth", "is_truth", "log_evidence_of", "study_with_truth_alone"]

FITTED_ALONE = "truth_alone"  # folder and study of the diagnosis whose catalogue holds only what is hidden


def evidence_of_truth(folder: Path) -> float | None:
    """Return the log Bayes factor of the true model over the one without effects, nats.

    Parameters
    ----------
    folder : Path
        Of a judged case, with ``truth.json`` and ``out/decisions.json``; where the search did not try the true model,
        that of the diagnosis with the truth alone counts.

    Returns
    -------
    float or None
        None where neither has tried it, or there was no answer.
    """
    accepted = _accepted(folder)
    for out in ("out", FITTED_ALONE):
        path = folder / out / "decisions.json"
        if accepted and path.is_file():
            models = json.loads(path.read_text(encoding="utf-8"))["models"]
            known = [(m["effects"], e) for m in models if (e := log_evidence_of(m)) is not None]
            true = [e for effects, e in known if is_truth(effects, accepted)]
            none = [e for effects, e in known if not effects]
            if true and none:
                return max(true) - max(none)
    return None


def study_with_truth_alone(folder: Path, names: Sequence[str]) -> Path | None:
    """Write a study of a judged case whose catalogue holds only what is hidden, and return it.

    Parameters
    ----------
    folder : Path
    names : sequence of str
        ``kind@where`` of the whole catalogue of its model.

    Returns
    -------
    Path or None
        None where nothing in the catalogue is what is hidden.
    """
    patterns = [p for effect in _accepted(folder) for p in effect]
    include = [name for name in names if any(fnmatchcase(name, p) for p in patterns)]
    if not include:
        return None
    study = folder / f"{FITTED_ALONE}.toml"
    text = (folder / "study.toml").read_text(encoding="utf-8")
    study.write_text(f"{text}\n[candidates]\ninclude = {json.dumps(include)}\n", encoding="utf-8")
    return study


def log_evidence_of(model: Mapping[str, Any], *, as_held: bool = False) -> float | None:
    """Return the log evidence of a model in decisions.json without prior odds; None where it could not be fitted.

    Parameters
    ----------
    model : mapping
    as_held : bool
        Whether what is overstated is left out, as in the probabilities.
    """
    parts = model.get("log_evidence")
    if not parts or parts["total"] is None or not math.isfinite(parts["total"]):
        return None  # null where a strength would act the other way
    overstated = float(parts.get("overstated", 0.0)) if as_held else 0.0
    return float(parts["total"]) - float(parts["log_prior_odds"]) - overstated


def is_truth(effects: Sequence[str], accepted: Sequence[Sequence[str]]) -> bool:
    """Tell whether effects are the hidden ones, one for one.

    Examples
    --------
    >>> is_truth(["coulomb_friction@guide"], [["coulomb_friction@*", "stribeck_friction@*"]])
    True
    >>> is_truth(["coulomb_friction@guide", "backlash@gear"], [["coulomb_friction@*"]])
    False
    """
    return len(effects) == len(accepted) and any(
        all(any(fnmatchcase(name, pattern) for pattern in accept) for name, accept in zip(order, accepted, strict=True))
        for order in itertools.permutations(effects)
    )


def _accepted(folder: Path) -> list[list[str]]:
    """Return the names that count as right, as patterns, for each hidden effect; none where one has no name."""
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    accepted = [list(e["accept"]) for e in truth["effects"]]
    return accepted if all(accepted) else []
