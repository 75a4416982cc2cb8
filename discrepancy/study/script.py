"""The steps of a study as a Python script that takes them again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

__all__ = ["replay", "script_of"]


def script_of(steps: Sequence[Mapping[str, Any]], study: str | Path, seed: int | None = None) -> str:
    """Return a script that reads a study file, takes the steps, and writes the report.

    Parameters
    ----------
    steps : sequence of mapping
        As `discrepancy.Study` keeps them.
    study : path
        The study file.
    seed : int, optional
        Default: the study's.
    """
    given = f", seed={seed}" if seed is not None else ""
    lines = [
        "from discrepancy import Study",
        "",
        f"study = Study.from_file({str(study)!r}{given})",
        *(_line(step) for step in steps),
        'study.report("report.html")',
        "print(study.to_frame())",
    ]
    return "\n".join(lines) + "\n"


def _line(step: Mapping[str, Any]) -> str:
    action = step["action"]
    if action == "search":
        return "study.diagnose()" + ("  # it was stopped then; here it runs to its end" if step.get("stopped") else "")
    if action == "add":
        options = "".join(f", {k}={step[k]!r}" for k in ("strength", "shape") if step.get(k))
        return f"study.add({step['effect']!r}{options})"
    if action in ("leave_out", "use_again"):
        options = "".join(f", {k}={step[k]!r}" for k in ("start", "stop") if step.get(k) is not None)
        return f"study.{action}({step['record']!r}{options})"
    if action == "set_prior":
        options = "".join(f", {k}={step[k]!r}" for k in ("value", "std") if step.get(k) is not None)
        return f"study.set_prior({step['name']!r}{options})"
    if action == "add_curve":
        return f"study.add_curve({step['where']!r}, {step['over']!r})"
    if action == "switch":
        return f"study.switch({step['branch']!r})"
    return f"study.{action}()"


def replay(study: Any, steps: Sequence[Mapping[str, Any]]) -> None:
    """Take steps again on a study of the same model and records.

    Parameters
    ----------
    study : Study
    steps : sequence of mapping

    Raises
    ------
    ValueError
        If a step is none of those that a study can take.
    """
    for step in steps:
        action = step["action"]
        if action == "add":
            study.add(step["effect"], strength=step.get("strength"), shape=step.get("shape"))
        elif action in ("leave_out", "use_again"):
            times = {k: step[k] for k in ("start", "stop") if step.get(k) is not None}
            getattr(study, action)(step["record"], **times)
        elif action == "set_prior":
            study.set_prior(step["name"], step.get("value"), step.get("std"))
        elif action == "add_curve":
            study.add_curve(step["where"], step["over"])
        elif action == "switch":
            study.switch(step["branch"])
        elif action in ("undo", "redo"):
            getattr(study, action)()
        elif action == "search":
            study.diagnose()
        else:
            known = "add, add_curve, undo, redo, switch, leave_out, use_again, set_prior, search"
            raise ValueError(f"'{action}' is no step of a study: take one of {known}")
