"""The score of one answer: what is right and wrong in a ``diagnosis.json``, beside the case's ``truth.json``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

__all__ = ["UNKNOWN_VERDICTS", "WORSE", "Score", "judged", "score_names", "set_of"]

WORSE = 1.02  # of the recalibrated model's held-out error: what the noise of a record alone can move it by
SET = 0.95  # of the probability: what the answers that the records leave open reach together
UNKNOWN_VERDICTS = ("unknown effect", "partly explained")  # something is missing which has no name
CONFIDENT = 0.8  # probability from which a wrong name counts as a confident one


@dataclass(frozen=True)
class Statement:
    """Something that was said with a probability, and whether it is so.

    Parameters
    ----------
    said : str
        ``kind@where``, ``nothing`` or ``unknown``.
    probability : float
    true : bool
    """

    said: str
    probability: float
    true: bool


@dataclass(frozen=True, kw_only=True)
class Score:
    """What is right and wrong about an answer.

    Parameters
    ----------
    right : bool
        Nothing hidden and nothing named; every hidden effect in the answer and nothing else named; or, outside the
        catalogue, reported as unknown, and nothing named.
    first : bool
        The first effect named is hidden.
    in_set : bool
        Every hidden effect is named, or in the set of one that is named; where nothing is named, in one of the answers
        that together reach `SET` of the probability.
    set_size : float
        Mean number of names in the sets of the effects named; where none is, the number of those answers.
    invented : int
        Effects named that are not hidden, and whose set holds none that is.
    confident_wrong : bool
        A name that is not right has a probability of `CONFIDENT` or more.
    unknown : bool
        The verdict says that something is missing which has no name.
    worse : bool
        The final model predicts an output of the held-out records worse than the recalibrated one.
    held_out : float
        Largest held-out error of the final model over the achievable one, of all outputs.
    named : tuple of str
    statements : tuple of Statement
    """

    right: bool
    first: bool
    in_set: bool
    set_size: float
    invented: int
    confident_wrong: bool
    unknown: bool
    worse: bool
    held_out: float
    named: tuple[str, ...]
    statements: tuple[Statement, ...]


@dataclass(frozen=True, kw_only=True)
class _NameScore:
    """What is right and wrong about names alone: `Score` tells the meaning of each."""

    right: bool
    first: bool
    all_found: bool
    invented: int


def score_names(
    category: str, accepted: Sequence[Sequence[str]], sets: Sequence[Sequence[str]], *, silent: bool, unknown: bool
) -> _NameScore:
    """Score the names that a method gives.

    Parameters
    ----------
    category : str
        Of the case: "none", "outside", or what is hidden has names.
    accepted : sequence of sequence of str
        For each hidden effect the names that are right, as patterns of ``kind@where``.
    sets : sequence of sequence of str
        For each effect named, the weightiest first, what it may be, its name first.
    silent : bool
        Whether the method says that nothing is missing.
    unknown : bool
        Whether it says that something is missing which has no name.

    Examples
    --------
    >>> hidden, named = [["coulomb_friction@*"]], [["coulomb_friction@guide"]]
    >>> score_names("single", hidden, named, silent=False, unknown=False).right
    True
    """
    all_found = _all_in(accepted, sets)
    invented = sum(not any(_is_one_of(n, a) for n in each for a in accepted) for each in sets)
    return _NameScore(
        right={"none": silent, "outside": unknown and not sets}.get(category, all_found and not invented),
        first=bool(sets) and any(_is_one_of(sets[0][0], a) for a in accepted),
        all_found=all_found,
        invented=invented,
    )


def judged(truth: Mapping[str, Any], answer: Mapping[str, Any]) -> Score:
    """Score an answer.

    Parameters
    ----------
    truth : mapping
        ``truth.json``.
    answer : mapping
        ``diagnosis.json``.  Without ``"probabilities"`` what is named counts as certain.
    """
    category = truth["category"]
    accepted: list[Sequence[str]] = [e["accept"] for e in truth["effects"] if e["accept"]]
    named = [e for e in answer["effects"] if e["kind"] != "unknown_force"]
    sets = [set_of(effect, answer) for effect in named]
    unknown = answer["verdict"] in UNKNOWN_VERDICTS
    silent = not answer["effects"] and answer["verdict"] == "nothing missing"
    names = score_names(category, accepted, sets, silent=silent, unknown=unknown)
    left_open = [] if sets else _left_open(answer)
    statements = _statements(category, accepted, sets, answer, unknown)
    last, before = answer["stages"][-1]["validate"], answer["stages"][min(1, len(answer["stages"]) - 1)]["validate"]
    return Score(
        right=names.right,
        first=names.first,
        in_set=names.all_found or _all_in(accepted, left_open),
        set_size=sum(map(len, sets)) / len(sets) if sets else float(len(left_open)),
        invented=names.invented,
        confident_wrong=any(s.probability >= CONFIDENT and not s.true and "@" in s.said for s in statements),
        unknown=unknown,
        worse=bool(answer["effects"]) and any(last[n]["rmse"] > WORSE * v["rmse"] for n, v in before.items()),
        held_out=max(last[n]["rmse"] / floor for n, floor in truth["achievable"].items() if n in last),
        named=tuple(f"{e['kind']}@{e['where']}" for e in answer["effects"]),
        statements=statements,
    )


def _all_in(accepted: Sequence[Sequence[str]], sets: Sequence[Sequence[str]]) -> bool:
    """Tell whether there is something hidden and all of it is in some set."""
    return bool(accepted) and all(any(_is_one_of(n, a) for each in sets for n in each) for a in accepted)


def _left_open(answer: Mapping[str, Any]) -> list[list[str]]:
    """Return the most probable answers that reach `SET` together, each as the names of its effects."""
    answers: list[list[str]] = []
    reached = 0.0
    for entry in answer.get("probabilities", {}).get("models", []):
        if reached >= SET:
            break
        answers.append(list(entry["effects"]))
        reached += float(entry["probability"])
    return answers


def _name(entry: Mapping[str, Any]) -> str:
    return f"{entry['kind']}@{entry['where']}"


def _is_one_of(name: str, patterns: Sequence[str]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def set_of(effect: Mapping[str, Any], answer: Mapping[str, Any]) -> list[str]:
    """Return the names among which an effect was named, itself first."""
    probable = _probable(effect, answer)
    others = effect.get("indistinguishable_from", []) if probable is None else probable.get("set", [])
    return list(dict.fromkeys([_name(effect), *map(_name, others)]))


def _probable(effect: Mapping[str, Any], answer: Mapping[str, Any]) -> Mapping[str, Any] | None:
    for entry in answer.get("probabilities", {}).get("effects", []):
        if _name(entry) == _name(effect):
            return dict(entry)
    return None


def _statements(
    category: str,
    accepted: Sequence[Sequence[str]],
    sets: Sequence[Sequence[str]],
    answer: Mapping[str, Any],
    unknown: bool,
) -> tuple[Statement, ...]:
    """Return all that was said with a probability; without probabilities, what was said counts as certain."""
    shown = answer.get("probabilities")
    if shown is None:
        nothing = float(answer["verdict"] == "nothing missing")
        pairs = [(each[0], 1.0) for each in sets]
        rest = {"nothing": nothing, "unknown": float(unknown)}
    else:
        rest = {key: float(shown[key]) for key in ("nothing", "unknown")}
        probability: dict[str, float] = {}
        for entry in shown["effects"]:
            for each in (entry, *entry.get("set", [])):
                if each["kind"] == "unknown_force":
                    continue  # part of "unknown"
                probability.setdefault(_name(each), float(each["probability"]))
        pairs = list(probability.items())
    true = {"nothing": category == "none", "unknown": category == "outside"}
    said = [Statement(name, p, any(_is_one_of(name, a) for a in accepted)) for name, p in pairs]
    return (*said, *(Statement(key, p, true[key]) for key, p in rest.items()))
