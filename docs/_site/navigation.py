"""The navigation of the site, laid out from its folders."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

SECTIONS = {
    "tutorial": "Tutorial",
    "gallery": "Gallery",
    "howto": "How to",
    "physics": "Physics",
    "method": "Method",
    "benchmarks": "Benchmarks",
    "reference": "Reference",
    "development": "Development",
}
NAMES = {"api": "API"}  # of folders within a section


def navigation(docs: Path) -> list[Any]:
    """Return the navigation: the home page, then every section that has pages."""
    nav: list[Any] = ["index.md"]
    nav += [{title: entries} for folder, title in SECTIONS.items() if (entries := _pages(docs / folder, docs))]
    return nav


def _pages(folder: Path, docs: Path) -> list[Any]:
    """Navigation of a folder: its index, its pages in the order in which the index links them, then its folders."""
    if not folder.is_dir():
        return []
    index = folder / "index.md"
    linked = re.findall(r"\(([\w-]+\.md)", index.read_text(encoding="utf-8")) if index.is_file() else []
    place = {name: k for k, name in reversed(list(enumerate(linked)))}
    pages = sorted(folder.glob("*.md"), key=lambda path: (path != index, place.get(path.name, len(linked)), path.name))
    entries: list[Any] = [path.relative_to(docs).as_posix() for path in pages]
    for below in sorted(path for path in folder.iterdir() if path.is_dir()):
        if inside := _pages(below, docs):
            entries.append({NAMES.get(below.name) or below.name.replace("-", " ").capitalize(): inside})
    return entries
