"""The front doors: what ``from PACKAGE import …`` offers, as listed in the ``__init__.pyi`` of the package."""

from __future__ import annotations

import ast
import importlib
import inspect
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOORS = sorted(
    ".".join(path.parent.relative_to(ROOT).parts)
    for package in ("multibody", "estimation", "surrogate", "discrepancy", "operation", "vtsdt", "gearbox")
    for path in (ROOT / package).rglob("__init__.pyi")
)


def _stub(door: str) -> ast.Module:
    return ast.parse((ROOT / Path(*door.split(".")) / "__init__.pyi").read_text(encoding="utf-8"))


def _listed(door: str) -> list[str]:
    """Return the names in ``__all__`` of a stub, which is what type checkers and editors see."""
    (value,) = (
        n.value for n in _stub(door).body if isinstance(n, ast.Assign) and ast.unparse(n.targets[0]) == "__all__"
    )
    return ast.literal_eval(value)


def test_there_are_front_doors() -> None:
    assert "surrogate" in DOORS


@pytest.mark.parametrize("door", DOORS)
def test_every_name_resolves_to_its_definition_and_is_documented(door: str) -> None:
    module = importlib.import_module(door)
    assert sorted(_listed(door)) == sorted(module.__all__)
    for name in module.__all__:
        value = getattr(module, name)
        if inspect.isclass(value) or inspect.isroutine(value):
            assert value.__name__ == name
            assert inspect.getdoc(value), f"{door}.{name} has no docstring"
        else:
            assert not inspect.ismodule(value), f"{door}.{name} is a module"


@pytest.mark.parametrize("door", DOORS)
def test_a_name_that_is_not_offered_is_an_error(door: str) -> None:
    module = importlib.import_module(door)
    assert set(dir(module)) == set(module.__all__)
    with pytest.raises(AttributeError, match="nothing_of_this_name"):
        _ = module.nothing_of_this_name
