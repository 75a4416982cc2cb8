"""The history of a study in a file: from it every stage can be built again exactly, and the search continued.

A stage is defined by its effects and its fitted values.  One simulation at these values gives the same errors,
intervals and figures to the last digit, without a search and without a fit.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from discrepancy.effects.effect import Effect
from discrepancy.problem.problem import Problem
from discrepancy.problem.study_file import StudyError
from discrepancy.problem.tables import MOST_ROWS
from discrepancy.stages.stage import AcceptedEffect, RivalExplanation, Stage
from discrepancy.study.left_out import Stretch
from discrepancy.study.priors import Prior
from discrepancy.study.snapshot import Snapshot
from discrepancy.study.study import Study
from multibody.base.json_file import write_json_atomically
from multibody.machine.model import Model

__all__ = ["SCHEMA", "fingerprint", "restore", "save_history"]

SCHEMA = 1
#: Moments of a study beside the latest.
MOMENTS = ("past", "undone", "cut")
#: Stages by what defines them.
Made = dict[str, Stage]


def fingerprint(study: Study) -> str:
    """Return a hash of the model, the records and the settings of the study."""
    problem = study.source
    digest = hashlib.sha256()
    parts = [
        *_parts_of(problem.model),
        *(f"{q.name} {q.value!r} {q.std!r} {q.min!r} {q.max!r}" for q in problem.uncertain),
        *(f"{n} {v!r}" for n, v in sorted(problem.noise.items())),
        repr((problem.include, problem.exclude, problem.level, problem.seed, problem.residual, problem.inputs)),
        *([problem.search] if problem.search != "auto" else []),
        *([str(problem.most_rows)] if problem.most_rows != MOST_ROWS else []),
    ]
    for text in parts:
        digest.update(text.encode() + b"\0")
    for e in (*problem.identify, *problem.validate):
        digest.update(
            repr((e.inputs, e.outputs, e.preparation, sorted(e.start.items()), e.free, e.offsets, e.clocks)).encode()
        )
        digest.update(np.ascontiguousarray(e.record.time).tobytes())
        for name in (*e.inputs, *e.outputs):
            digest.update(np.ascontiguousarray(e.record.signals[name].values).tobytes())
    return digest.hexdigest()[:16]


def _parts_of(model: Model) -> Iterator[str]:
    """Return what defines a model, without the words of its description, which may change between versions."""
    for name, component in model.components.items():
        values = [(k, float(v)) for k, v in sorted((component.values | component.starts).items())]
        tables = [(k, x.tolist(), y.tolist()) for k, (x, y) in sorted(component.tables.items())]
        yield repr((name, type(component).__name__, values, sorted(component.options.items()), tables))
    yield repr([tuple(ends) for ends in model.connections])
    yield repr([(i.name, tuple(i.targets), i.default) for i in model.inputs.values()])
    yield repr(sorted(model.outputs.items()))


def _entry(stage: Stage) -> dict[str, Any]:
    accepted = stage.accepted
    return {
        "name": stage.name,
        "effects": [dataclasses.asdict(e) for e in stage.effects],
        "accepted": None
        if accepted is None
        else {
            "effect": dataclasses.asdict(accepted.effect),
            "p_value": accepted.p_value,
            "delta_bic": accepted.delta_bic,
            "rivals": [dataclasses.asdict(r) for r in accepted.rivals],
            "hidden_by": accepted.masked_by,
        },
        "values": stage.identify.to_dict(),
        "std": [float(s) if np.isfinite(s) else None for s in stage.identify.std],
        "degrees": stage.identify.degrees,
        "own": [{k: float(v) for k, v in f.own.items()} for f in stage.identify.fits],
        "scale": stage.identify.scale,
        "noise": dict(stage.noise),
        "notes": list(stage.notes),
        "rmse": {part: stage.rmse(part) for part in ("identify", "validate")},
    }


def _moment(at: Snapshot) -> dict[str, Any]:
    """Return what defines a study at a moment."""
    return {
        "settled": not at["elimination_pending"],
        "in_windows_instead": at["prepared"].reason if at["in_windows_instead"] else "",
        "left_out": [s.to_dict() for s in at.left_out],
        "priors": [p.to_dict() for p in at.priors],
        "stages": [_entry(s) for s in at.stages],
        "answer": dict(at["answer"]),
    }


def _kept(at: Snapshot) -> dict[str, Any]:
    """Return the entry of an earlier moment, which never changes."""
    if at.entry is None:
        at.entry = _moment(at)
    return at.entry


def save_history(state: Study, path: str | Path) -> Path:
    """Write the stages of a study, its steps, and what undoing and redoing them leads to; return the path."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    content = {
        "schema": SCHEMA,
        "study": state.problem.name,
        "file": str(state.problem.path.resolve()) if state.problem.path is not None else None,
        "fingerprint": fingerprint(state),
        "seed": state.problem.seed,
        "steps": state.steps,
        **_moment(Snapshot.of(state)),
        **{name: [_kept(at) for at in getattr(state, name)] for name in MOMENTS},
    }
    return write_json_atomically(path, content)


def read_history(path: str | Path) -> dict[str, Any]:
    """Read what `save_history` wrote.

    Raises
    ------
    StudyError
        If the file is not such a history.
    OSError
        If it cannot be read.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"), parse_constant=_refuse)
    except ValueError as error:
        raise StudyError([f"{path}: this is not the history of a study: {error}"]) from error
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        schema = content.get("schema") if isinstance(content, dict) else None
        raise StudyError([f"{path}: the schema of this history is {schema!r}, and schema {SCHEMA} is needed"])
    missing = [k for k in ("fingerprint", "settled", "stages") if k not in content]
    if missing:
        raise StudyError([f"{path}: the entry '{k}' is missing" for k in missing])
    return content


def _refuse(constant: str) -> float:
    """Raise for a number that no history is written with."""
    raise ValueError(f"{constant} is no finite number")


def restore(state: Study, path: str | Path) -> None:
    """Restore the stages of a history in a new study of the same model and records.

    Raises
    ------
    StudyError
        If the history belongs to another model, other records or other settings, or is damaged.
    """
    content = read_history(path)
    if content["fingerprint"] != fingerprint(state):
        raise StudyError(
            [
                f"{path}: this history belongs to another model, other records or other settings of the study (seed "
                f"{content.get('seed')}): use the study as it was, or start again in another folder"
            ]
        )
    state.steps[:] = content.get("steps", [])
    made: Made = {}
    _take_up(state, path, content, made)
    for name in MOMENTS:
        getattr(state, name)[:] = [_later(state.source, path, entry, made) for entry in content.get(name, [])]


def _later(source: Problem, path: str | Path, entry: dict[str, Any], made: Made) -> Snapshot:
    """Return another moment of a history, which is built when it is wanted."""

    def built() -> Study:
        study = Study(source)
        _take_up(study, path, entry, made)
        return study

    names = [stage.get("name", "") for stage in entry["stages"]]
    return Snapshot(names, *_used(entry), built, entry)


def _used(entry: dict[str, Any]) -> tuple[list[Stretch], list[Prior]]:
    """Return what is left out and which priors are others at a moment."""
    return [_stretch(e) for e in entry.get("left_out", [])], [Prior(**e) for e in entry.get("priors", [])]


def _take_up(state: Study, path: str | Path, content: dict[str, Any], made: Made) -> None:
    """Build the stages of a moment in a study without stages; those that stood at another moment too are made once."""
    left_out, priors = _used(content)
    if left_out or priors:
        state.begin_with(left_out, priors)
    state.prepare()
    windows = content.get("in_windows_instead", "")
    if windows and state.cut_into_windows() and state.prepared is not None:
        state.prepared = dataclasses.replace(state.prepared, reason=windows)
    state.stages.clear()
    for k, entry in enumerate(content["stages"]):
        key = json.dumps([content.get("left_out", []), content.get("priors", []), windows, k, entry])
        if key not in made:
            state.progress(f"restore stage '{entry.get('name', k)}'")
            try:
                stage = state.restored(
                    entry["name"],
                    tuple(_effect(e) for e in entry["effects"]),
                    entry["values"],
                    [np.array(list(own.values()), dtype=float) for own in entry["own"]],
                    entry["scale"],
                    entry["noise"],
                    moved=k > 0,
                )
                if "std" in entry:  # of the likelihood, where the search went by that
                    std = np.array([np.inf if s is None else s for s in entry["std"]])
                    identify = dataclasses.replace(stage.identify, std=std, degrees=entry["degrees"])
                    stage = dataclasses.replace(stage, identify=identify)
                accepted = _accepted(entry["accepted"])
            except (KeyError, TypeError, ValueError) as error:
                raise StudyError([f"{path}: stage {k} is damaged: {type(error).__name__}: {error}"]) from error
            made[key] = dataclasses.replace(stage, accepted=accepted, notes=tuple(entry["notes"]))
        state.stages.append(made[key])
    state.elimination_pending = not content["settled"]
    state.answer = content.get("answer", {})


def _stretch(entry: dict[str, Any]) -> Stretch:
    start, stop = entry["start"], entry["stop"]
    return Stretch(entry["record"], -np.inf if start is None else start, np.inf if stop is None else stop)


def _effect(entry: dict[str, Any]) -> Effect:
    return Effect(**{**entry, "ports": tuple(entry["ports"])})


def _accepted(entry: dict[str, Any] | None) -> AcceptedEffect | None:
    if entry is None:
        return None
    rivals = tuple(RivalExplanation(**r) for r in entry["rivals"])
    effect = _effect(entry["effect"])
    return AcceptedEffect(
        effect=effect,
        p_value=entry["p_value"],
        delta_bic=entry["delta_bic"],
        rivals=rivals,
        masked_by=entry.get("hidden_by", ""),
    )
