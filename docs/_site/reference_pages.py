"""A reference page for each package that offers names to users."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
from pathlib import Path

PACKAGES = ("multibody", "estimation", "surrogate", "discrepancy", "vtsdt", "gearbox")
COMPONENTS = ("multibody.library", "vtsdt.parts")  # packages of components


def reference_pages(root: Path) -> dict[str, str]:
    """Return the pages by their names; a name that several packages offer is shown on the first of their pages."""
    written: dict[str, str] = {}
    shown: dict[str, str] = {}
    for package, names in public_names(root).items():
        parts = [f"# {package}", f"::: {package}\n    options:\n      members: []"]
        others = [f"`{name.rpartition('.')[2]}` ([{shown[name]}]({shown[name]}.md))" for name in names if name in shown]
        if others:
            parts.append(f"Also imported from here: {', '.join(others)}.")
        parts += [_shown(name) for name in names if name not in shown]
        shown |= {name: package for name in names if name not in shown}
        written[f"{package}.md"] = "\n\n".join(parts) + "\n"
    return written


def public_names(root: Path) -> dict[str, list[str]]:
    """Full names of what each package offers, by the package that one imports it from.

    A package offers what its ``__init__`` names in ``__all__`` or, where it loads names when they are first asked for,
    in the ``__init__.pyi`` beside it.
    """
    pages = {}
    for top in PACKAGES:
        for source in sorted((root / top).rglob("__init__.py"), key=lambda path: path.parent.as_posix()):
            package = ".".join(source.parent.relative_to(root).parts)
            stub = source.with_suffix(".pyi")
            if names := _offered(stub if stub.is_file() else source, package):
                pages[package] = names
    return pages


def _offered(file: Path, package: str) -> list[str]:
    """Full names of what an ``__init__`` takes from modules and lists in ``__all__``."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    listed: set[str] = set()
    for node in tree.body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__":
            listed = {str(each.value) for each in ast.walk(node.value) if isinstance(each, ast.Constant)}
    names = []
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and node.module:
            module = f"{package}.{node.module}" if node.level else node.module
            names += [f"{module}.{each.name}" for each in node.names if (each.asname or each.name) in listed]
    return sorted(names, key=lambda name: name.rpartition(".")[2].lower())


def _shown(name: str) -> str:
    """Return the entry of a name: from its source or, of a component, whose docstring is made, from the class."""
    module, _, last = name.rpartition(".")
    value = getattr(importlib.import_module(module), last) if ".".join(name.split(".")[:2]) in COMPONENTS else None
    if not isinstance(value, type) or not hasattr(value, "declarations"):
        options = "show_root_heading: true, show_root_toc_entry: true, show_root_full_path: false, heading_level: 2"
        return f"::: {name}\n    options: {{{options}}}"
    lines = [f"## {last}", ""]
    for section in re.split(r"\n(?=\w+\n-{3,}\n)", inspect.getdoc(value) or ""):
        title, underline, entries = section.partition("\n---")
        if not underline:
            lines += [section, ""]
            continue
        lines += [f"**{title}**", "", "| name | what it is | meaning |", "| --- | --- | --- |"]
        for entry in re.split(r"\n(?=\S)", entries.partition("\n")[2].strip()):
            head, _, meaning = entry.partition("\n")
            word, _, kind = head.partition(" : ")
            lines.append(f"| `{word}` | {kind.rstrip(', ')} | {' '.join(meaning.split())} |")
        lines.append("")
    return "\n".join(lines)
