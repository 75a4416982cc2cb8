"""The glossary names places in the code that exist, and each term once."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

GLOSSARY = Path(__file__).resolve().parents[2] / "docs" / "reference" / "glossary.md"
ROWS = [
    [cell.strip() for cell in line.strip("|\n ").split(" | ")]
    for line in GLOSSARY.read_text(encoding="utf-8").splitlines()
    if line.startswith("| ") and not line.startswith(("| term", "| ---"))
]


def test_every_place_exists() -> None:
    places = [place for row in ROWS for place in re.findall(r"`([\w.]+)`", row[-1])]
    assert len(places) >= len(ROWS)
    assert [place for place in places if importlib.util.find_spec(place) is None] == []


def test_each_term_stands_once() -> None:
    terms = [row[0] for row in ROWS]
    assert sorted(set(terms)) == sorted(terms)
