"""The benchmark runner: entries take turns, are compared within a round, and faults are named."""

from __future__ import annotations

import ast
import importlib.util
import random
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]

FILE = '''
"""Two ways.

More about them.
"""
CALLS = []


def bench_a():
    """first way"""

    def work():
        CALLS.append("a")
        return 0.002

    return work


def bench_b():
    """second way"""

    def work():
        CALLS.append("b")
        return 0.001

    return work
'''


@pytest.fixture(scope="module")
def runner() -> ModuleType:
    spec = importlib.util.spec_from_file_location("benchmark_runner", ROOT / "benchmarks" / "run.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up by name
    spec.loader.exec_module(module)
    return module


def _group(runner: ModuleType, folder: Path, text: str = FILE) -> object:
    path = folder / "bench_ways.py"
    path.write_text(text.lstrip())
    return runner.load(path)


def test_entries_take_turns_after_one_call_each(runner: ModuleType, tmp_path: Path) -> None:
    group = _group(runner, tmp_path)
    calls = group.entries[0].work.__globals__["CALLS"]  # type: ignore[attr-defined]
    runner.measure(group, rounds=20, seconds=60.0, rng=random.Random(1))
    assert calls[:2] == ["a", "b"]
    rounds = [tuple(calls[i : i + 2]) for i in range(2, len(calls), 2)]
    assert len(rounds) == 20
    assert set(rounds) == {("a", "b"), ("b", "a")}


def test_table_compares_with_the_first_entry(runner: ModuleType, tmp_path: Path) -> None:
    group = _group(runner, tmp_path)
    runner.measure(group, rounds=5, seconds=60.0, rng=random.Random(1))
    assert runner.rows(group) == [
        ("first way", "2.00 ms", "2.00 ms to 2.00 ms", "1", "5"),
        ("second way", "1.00 ms", "1.00 ms to 1.00 ms", "0.5 (0.5 to 0.5)", "5"),
    ]
    text = runner.page([group])
    assert "\n## Two ways\n\nMore about them.\n" in text
    assert "| second way | 1.00 ms |" in text


def test_a_section_is_written_in_the_place_of_its_old_one(runner: ModuleType, tmp_path: Path) -> None:
    group = _group(runner, tmp_path)
    runner.measure(group, rounds=5, seconds=60.0, rng=random.Random(1))
    group.subject = "other"  # type: ignore[attr-defined]
    first = runner.page([group])
    group.subject = "ways"  # type: ignore[attr-defined]
    both = runner.page([group], "wall", first)
    assert both.count("## Two ways") == 2
    assert runner.page([group], "wall", both) == both
    again = runner.page([group], "cpu", both)
    assert again.count("## Two ways") == 2
    assert again.count("processor time") == 1


def test_no_new_round_once_the_time_is_spent_but_never_fewer_than_three(runner: ModuleType, tmp_path: Path) -> None:
    group = _group(runner, tmp_path)
    runner.measure(group, rounds=50, seconds=0.0, rng=random.Random(1))
    assert [len(entry.times) for entry in group.entries] == [3, 3]  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('"""Nothing."""\n', "no function named bench_"),
        ("def bench_a():\n    return print\n", "bench_a needs a docstring"),
        ('def bench_a():\n    """a"""\n    return 1.0\n', "bench_a must return the callable"),
    ],
)
def test_faults_of_a_benchmark_file_are_named(runner: ModuleType, tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        _group(runner, tmp_path, text)


def test_every_shipped_benchmark_has_a_title_and_names(runner: ModuleType) -> None:
    """Text only: preparing the entries may take longer than a quick test has."""
    for path in sorted((ROOT / "benchmarks").glob("bench_*.py")):
        text = path.read_text(encoding="utf-8")
        tree = ast.parse(text)
        assert ast.get_docstring(tree), path.name
        functions = [n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name.startswith("bench_")]
        assert functions or "globals().update(" in text, path.name  # entries that several files share
        names = [ast.get_docstring(function) for function in functions]
        assert all(names), path.name
        assert len(set(names)) == len(names), path.name
