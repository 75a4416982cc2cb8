"""The house around the code: who may import whom, what an import costs, what is documented, the README."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("multibody", "estimation", "surrogate", "discrepancy", "vtsdt", "gearbox")
GROUND = {"multibody", "estimation", "surrogate", "discrepancy"}
MAY_IMPORT: dict[str, set[str]] = {
    "multibody": set(),
    "surrogate": set(),
    "estimation": {"multibody"},
    "discrepancy": {"estimation", "multibody"},
    "vtsdt": GROUND,
    "gearbox": GROUND,
}
HEAVY = ("numba", "scipy", "pandas", "matplotlib", "pint", "jinja2", "rich", "pyarrow")
LONGEST_FILE = 400


def _files() -> dict[str, Path]:
    """Path of each module of the packages by dotted name; a package stands for its ``__init__``."""
    files = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return files


FILES = _files()


def _is_type_checking(node: ast.AST) -> bool:
    if not isinstance(node, ast.If):
        return False
    test = node.test
    name = test.attr if isinstance(test, ast.Attribute) else getattr(test, "id", "")
    return name == "TYPE_CHECKING"


def _imports(tree: ast.AST, at_import: bool) -> Iterator[ast.Import | ast.ImportFrom]:
    """Import statements that run; with ``at_import`` only those that run when the module is imported."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        elif _is_type_checking(node):
            for below in getattr(node, "orelse", []):
                yield from _imports(below, at_import)
        elif not (at_import and isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)):
            yield from _imports(node, at_import)


def _targets(module: str, node: ast.Import | ast.ImportFrom, files: dict[str, Path]) -> set[str]:
    """Modules among ``files`` that an import statement in ``module`` names."""
    if isinstance(node, ast.Import):
        return {alias.name for alias in node.names if alias.name in files}
    base = node.module or ""
    if node.level:
        parts = module.split(".")
        is_package = files[module].name == "__init__.py"
        parts = parts[: len(parts) - node.level + (1 if is_package else 0)]
        base = ".".join([*parts, base] if base else parts)
    found = set()
    for alias in node.names:
        below = f"{base}.{alias.name}"
        if below in files:
            found.add(below)
        elif base in files:
            found.add(base)
    return found


def _graph(files: dict[str, Path], at_import: bool) -> dict[str, set[str]]:
    graph = {}
    for module, path in files.items():
        tree = ast.parse(path.read_text(encoding="utf-8"), str(path))
        targets = {t for node in _imports(tree, at_import) for t in _targets(module, node, files)}
        graph[module] = targets - {module}
    return graph


def _wrong_arrows(files: dict[str, Path]) -> list[str]:
    wrong = []
    for module, targets in _graph(files, at_import=False).items():
        package = module.split(".")[0]
        # The command line calls each package's own subcommand when it is asked for it.
        allowed = set(PACKAGES) if module.startswith("vtsdt.cli") else MAY_IMPORT[package] | {package}
        wrong += [f"{module} imports {t}" for t in sorted(targets) if t.split(".")[0] not in allowed]
    return wrong


def _circle(graph: dict[str, set[str]]) -> list[str]:
    """One circle of imports as a list of modules, or an empty list."""
    done: set[str] = set()

    def walk(module: str, trail: list[str]) -> list[str]:
        if module in trail:
            return [*trail[trail.index(module) :], module]
        if module in done:
            return []
        for target in sorted(graph[module]):
            found = walk(target, [*trail, module])
            if found:
                return found
        done.add(module)
        return []

    for module in graph:
        found = walk(module, [])
        if found:
            return found
    return []


def test_arrows_between_packages_run_one_way() -> None:
    assert _wrong_arrows(FILES) == []


def test_no_circles_between_files() -> None:
    assert _circle(_graph(FILES, at_import=True)) == []


def test_the_import_check_sees_what_it_forbids(tmp_path: Path) -> None:
    """The two tests above must not pass because nothing was parsed."""
    sources = {
        "multibody": "from .a import f\n",
        "multibody.a": "import numpy\ndef f():\n    from estimation.records import read\n",
        "multibody.b": "from multibody import f\nif TYPE_CHECKING:\n    from . import c\n",
        "multibody.c": "from .b import f\n",
        "estimation.records": "from multibody import f\n",
        "vtsdt.cli": "def main():\n    import gearbox.updating\n",
        "vtsdt.lift": "from gearbox import updating\n",
        "gearbox.updating": "",
    }
    files = {}
    for module, text in sources.items():
        name = "__init__" if module == "multibody" else module.replace(".", "_")
        files[module] = tmp_path / f"{name}.py"
        files[module].write_text(text)
    assert _wrong_arrows(files) == [
        "multibody.a imports estimation.records",
        "vtsdt.lift imports gearbox.updating",
    ]
    graph = _graph(files, at_import=True)
    assert _circle(graph) == []
    graph["multibody.a"].add("multibody.c")
    assert _circle(graph) == ["multibody", "multibody.a", "multibody.c", "multibody.b", "multibody"]


@pytest.mark.parametrize("package", PACKAGES)
def test_importing_a_package_is_light(package: str) -> None:
    code = f"import sys, {package}; print([m for m in {HEAVY!r} if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)
    assert run.stdout.strip() == "[]", run.stdout + run.stderr


def test_every_folder_with_modules_is_a_package() -> None:
    """A folder without ``__init__`` imports all the same, but no reference page can be made from it."""
    folders = {path.parent for path in FILES.values()}
    assert [str(f.relative_to(ROOT)) for f in sorted(folders) if not (f / "__init__.py").is_file()] == []


def _undocumented(path: Path) -> Iterator[str]:
    """What is public and has no docstring; a method of a subclass may inherit its own."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    where = path.relative_to(ROOT)
    if not ast.get_docstring(tree):
        yield f"{where}: the module"
    for node in tree.body:
        if not isinstance(node, ast.FunctionDef | ast.ClassDef) or node.name.startswith("_"):
            continue
        if not ast.get_docstring(node):
            yield f"{where}:{node.lineno}: {node.name}"
        if isinstance(node, ast.ClassDef) and not node.bases:
            for method in node.body:
                if not isinstance(method, ast.FunctionDef) or method.name.startswith("_"):
                    continue
                if not ast.get_docstring(method):
                    yield f"{where}:{method.lineno}: {node.name}.{method.name}"


def test_what_is_public_has_a_docstring() -> None:
    public = [p for m, p in FILES.items() if not any(part.startswith("_") for part in m.split("."))]
    assert [line for path in public for line in _undocumented(path)] == []


def test_no_file_holds_more_than_one_subject_can_fill() -> None:
    lines = {m: len(path.read_text(encoding="utf-8").splitlines()) for m, path in FILES.items()}
    assert {module: n for module, n in lines.items() if n > LONGEST_FILE} == {}


def _readme_command(name: str) -> str:
    script = ROOT / ".ci" / "readme_command"
    return subprocess.run(["bash", str(script), name], capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize("name", ["main", "test"])
def test_readme_command_sets_up_a_fresh_machine(name: str) -> None:
    command = _readme_command(name)
    assert command.strip() in (ROOT / "README.md").read_text(encoding="utf-8")
    lines = command.splitlines()
    assert lines[0] == "python3 -m venv .venv && . .venv/bin/activate"
    assert lines[1].startswith("pip install")
    assert "-c constraints.txt" in lines[1]
    assert subprocess.run(["bash", "-n"], input=command, text=True, check=False).returncode == 0


def test_readme_gives_each_command_once_and_in_order() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert re.findall(r"<!-- command: (\w+) -->\n```sh\n", readme) == ["main", "test"]


def test_ci_runs_the_readme_commands_and_not_copies_of_them() -> None:
    run = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert set(re.findall(r"readme_command (\w+)", run)) == {"main", "test"}
    assert not re.search(r"^\s*step .*\b(pytest|vtsdt)\b", run, re.MULTILINE)


def test_readme_command_that_is_not_there_is_an_error() -> None:
    with pytest.raises(subprocess.CalledProcessError):
        _readme_command("nothing")


def test_every_dependency_has_a_locked_version_and_no_line_names_a_host() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *extras["test"], *extras["lint"], *extras["docs"]]
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    locked = [line for line in lines if not line.startswith("#")]
    assert [line for line in locked if not re.fullmatch(r"[\w.-]+==[\w.+!]+", line)] == []

    def plain(requirement: str) -> str:
        name = re.split(r"[\[<>=!~; ]", requirement)[0]
        return re.sub(r"[-_.]+", "-", name).lower()

    assert {plain(w) for w in wanted} - {plain(line) for line in locked} == set()


def test_what_the_readme_names_exists() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    named = re.findall(r"\]\((?!http)([^)#]+)\)", readme)
    named += re.findall(r"`((?:docs/|[A-Z]+\.md|LICENSE)[^`]*)`", readme)
    assert named
    assert [name for name in named if not (ROOT / name).exists()] == []
