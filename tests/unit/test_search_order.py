"""Models are extended best first, and the search ends once the best was extended in vain."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from discrepancy.evidence.moves import TriedModel
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.search import EvidenceSearch


def search_with(**totals: float) -> EvidenceSearch:
    """Return a search that has fitted one model for each letter, none of which was extended."""
    state: Any = SimpleNamespace()
    search = EvidenceSearch(state)
    search.tried.with_noise_of = lambda source, model: False  # type: ignore[method-assign]
    for letter, total in totals.items():
        evidence: Any = SimpleNamespace(total=total)
        likelihood: Any = SimpleNamespace(grow=True)  # its noise is as rich as it gets
        search.tried.models[letter,] = TriedModel(key=(letter,), likelihood=likelihood, evidence=evidence, better=True)
    return search


def order(search: EvidenceSearch) -> str:
    letters = ""
    while (model := search._next()) is not None:
        model.expanded = True
        search.expansions += 1
        letters += model.key[0]
    return letters


@pytest.mark.parametrize(
    ("behind", "extended"), [(POLICY.improvement - 0.1, "ab"), (POLICY.improvement + 0.1, "a"), (0.0, "ab")]
)
def test_after_the_best_only_what_is_as_good_is_extended(behind: float, extended: str) -> None:
    assert order(search_with(a=100.0, b=100.0 - behind)) == extended


def test_what_is_better_than_what_it_was_made_of_comes_next() -> None:
    search = search_with(a=100.0, b=98.0)
    first = search._next()
    assert first is not None
    first.expanded = True
    search.tried.models.update(search_with(c=150.0).tried.models)
    assert order(search) == "c"


def test_no_more_models_are_extended_than_the_policy_has() -> None:
    totals = {letter: 100.0 for letter in "abcdefgh"}
    search = search_with(**totals)
    search.expansions = POLICY.expansions - 2
    assert order(search) == "ab"


def test_rivals_are_compared_under_the_random_forces_found_beside_the_best_of_them() -> None:
    search = search_with(a=100.0, b=80.0, c=70.0)
    asked = []

    def with_noise_of(source: TriedModel, model: TriedModel) -> bool:
        asked.append((source.key[0], model.key[0]))
        better = model.key == ("b",) and source.key == ("a",)
        if better:
            model.evidence = SimpleNamespace(total=105.0)  # type: ignore[assignment]
        return better

    search.tried.with_noise_of = with_noise_of  # type: ignore[method-assign]
    assert order(search) == "b"
    assert asked == [("a", "b"), ("a", "c"), ("b", "a"), ("b", "c")]  # each once


@pytest.mark.parametrize(("alike", "extended"), [({"a": frozenset({"b"})}, "a"), ({"a": frozenset({"c"})}, "ab")])
def test_what_only_has_another_name_is_not_extended_as_well(alike: dict[str, frozenset[str]], extended: str) -> None:
    """A constant force and an offset of a pressure may be one to the records; beside either the same lacks."""
    search = search_with(a=100.0, b=99.0)
    search.tried.models["a",].proposals = SimpleNamespace(alike=alike)  # type: ignore[assignment]
    assert order(search) == extended
