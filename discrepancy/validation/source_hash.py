"""A hash of the sources that a result depends on: those of some modules and of all that they import.

A commit that touches none of these leaves the hash as it is.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

__all__ = ["source_hash", "sources"]

#: The project's packages, whose sources count; others are named by their versions elsewhere.
PACKAGES = ("multibody", "estimation", "surrogate", "discrepancy", "operation", "vtsdt", "gearbox")
ROOT = Path(__file__).resolve().parents[2]
#: Digits shown.
DIGITS = 12


def source_hash(*modules: str, data: Iterable[str] = ()) -> str:
    """Return the first twelve digits of the SHA-256 of the sources behind some modules.

    Parameters
    ----------
    *modules : str
        Dotted names, such as ``"vtsdt.papers.lift"``.
    data : iterable of str
        Folders whose TOML and JSON files count as well, from the root of the project.
    """
    digest = hashlib.sha256()
    files = {p for folder in data for p in (ROOT / folder).rglob("*") if p.suffix in (".toml", ".json")}
    for path in sorted({*sources(*modules), *files}):
        digest.update(path.relative_to(ROOT).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:DIGITS]


def sources(*modules: str) -> set[Path]:
    """Return the files of some modules and of everything of the project that they import, wherever they import it.

    Imports for type checking alone do not count.  A name from a package that imports on first use counts as the module
    that its stub names.
    """
    paths: set[Path] = set()
    waiting = [*modules]
    while waiting:
        path = _file_of(waiting.pop())
        if path is None or path in paths:
            continue
        paths.add(path)
        waiting += _imported(path)
    return paths


def _file_of(module: str) -> Path | None:
    place = ROOT.joinpath(*module.split("."))
    for path in (place.with_suffix(".py"), place / "__init__.py"):
        if path.is_file():
            return path
    return None


@cache
def _imported(path: Path) -> tuple[str, ...]:
    """Return the modules of the project that a file imports, and the packages in which they stand."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    names: list[str] = []
    for node in _running(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            names += _from(node, path)
    own = [n for n in names if n.partition(".")[0] in PACKAGES]
    parents = [".".join(n.split(".")[:k]) for n in own for k in range(1, n.count(".") + 1)]
    return tuple(dict.fromkeys([*own, *parents]))


def _running(node: ast.AST) -> Iterator[ast.AST]:
    """Walk a tree without what stands under ``if TYPE_CHECKING``."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.dump(child.test):
            for other in child.orelse:
                yield other
                yield from _running(other)
            continue
        yield child
        yield from _running(child)


def _from(node: ast.ImportFrom, path: Path) -> list[str]:
    package = ".".join(path.relative_to(ROOT).parent.parts[: None if node.level <= 1 else 1 - node.level])
    base = ".".join(part for part in (package if node.level else "", node.module or "") if part)
    modules = [base]
    lazy = _stub(base)
    for alias in node.names:
        below = f"{base}.{alias.name}"
        modules.append(below if _file_of(below) else lazy.get(alias.name, base))
    return modules


@cache
def _stub(package: str) -> dict[str, str]:
    """Return the module of each name that a package's stub imports."""
    path = ROOT.joinpath(*package.split("."), "__init__.pyi")
    if not path.is_file():
        return {}
    names: dict[str, str] = {}
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom):
            module = f"{package}.{node.module}" if node.level else str(node.module)
            names |= {alias.asname or alias.name: module for alias in node.names}
    return names
