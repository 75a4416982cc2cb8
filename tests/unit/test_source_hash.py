"""The hash of the sources behind a result: it follows imports, and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from discrepancy.validation import source_hash as module
from discrepancy.validation.source_hash import source_hash, sources


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a small project whose page imports three ways."""
    files = {
        "gearbox/__init__.py": "",
        "gearbox/__init__.pyi": "from .parts.wheel import Wheel\n",
        "gearbox/page.py": (
            "from typing import TYPE_CHECKING\n"
            "if TYPE_CHECKING:\n    from gearbox.typed import T\n"
            "from gearbox import Wheel\n"
            "def chapters():\n    import gearbox.inside\n    from . import beside\n"
        ),
        "gearbox/parts/__init__.py": "",
        "gearbox/parts/wheel.py": "import numpy\n",
        "gearbox/inside.py": "",
        "gearbox/beside.py": "",
        "gearbox/typed.py": "",
        "gearbox/apart.py": "",
        "gearbox/data/paper.toml": "a = 1\n",
    }
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    monkeypatch.setattr(module, "ROOT", tmp_path)
    module._imported.cache_clear()
    module._stub.cache_clear()
    return tmp_path


def test_imports_count_wherever_they_stand_and_those_for_types_do_not(tree: Path) -> None:
    found = {p.relative_to(tree).as_posix() for p in sources("gearbox.page")}
    assert found == {
        f"gearbox/{n}.py" for n in ("__init__", "page", "inside", "beside", "parts/__init__", "parts/wheel")
    }


@pytest.mark.parametrize(
    ("changed", "moves"),
    [("gearbox/inside.py", True), ("gearbox/data/paper.toml", True), ("gearbox/apart.py", False)],
)
def test_a_change_elsewhere_leaves_the_hash(tree: Path, changed: str, moves: bool) -> None:
    before = source_hash("gearbox.page", data=("gearbox/data",))
    (tree / changed).write_text("b = 2\n", encoding="utf-8")
    assert (source_hash("gearbox.page", data=("gearbox/data",)) != before) is moves


def test_the_pages_depend_on_their_own_machine() -> None:
    lift = {p.relative_to(module.ROOT).parts[0] for p in sources("vtsdt.papers.lift")}
    gear = {p.relative_to(module.ROOT).parts[0] for p in sources("gearbox.papers.gearbox")}
    assert {"vtsdt", "multibody"} <= lift
    assert "gearbox" not in lift
    assert {"gearbox", "surrogate"} <= gear
    assert "vtsdt" not in gear
