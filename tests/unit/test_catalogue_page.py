"""The page of the catalogue shows every kind, and its links lead to headings of it."""

from __future__ import annotations

import importlib
import re

import pytest

from discrepancy.effects.alike import ALIKE
from discrepancy.effects.kinds import kinds


@pytest.fixture(scope="module")
def module():
    return importlib.import_module("docs._site.catalogue_page")


def test_every_kind_is_shown_once_with_law_cause_and_record(module):
    page = module.catalogue_page()
    for kind in module.shown():
        assert page.count(f"/{kind.name}.svg") == 1
        assert module.law_of(kind)
        assert kind.text.causes in page
        assert kind.text.confirm in page
    titles = re.findall(r"^### (.*)$", page, re.MULTILINE)
    assert len(titles) == len(set(titles)) == len(module.shown())


def test_links_within_the_page_lead_to_its_headings(module):
    page = module.catalogue_page()
    anchors = {
        re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", title).strip().lower())
        for title in re.findall(r"^#+ (.*)$", page, re.MULTILINE)
    }
    linked = set(re.findall(r"\]\(#([^)]*)\)", page))
    assert len(linked) > 30
    assert linked <= anchors


def test_kinds_that_are_alike_exist_and_each_kind_of_the_page_is_taken_for_something(module):
    named = {name for group in ALIKE for name in group.kinds}
    assert named <= set(kinds())
    assert {kind.name for kind in module.shown()} - named == set()


@pytest.mark.parametrize("kind", ["attached_mass", "sensor_lag", "input_delay", "turbulent_leakage", "resistance"])
def test_a_picture_is_drawn_from_the_law(module, kind):
    picture = module.kind_picture(kinds()[kind])
    assert picture.startswith("<?xml")
    assert picture == module.kind_picture(kinds()[kind])  # the same file at every build
