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
#: The house from the ground up.  A room may take from those of its package that stand before it, and from other
#: packages as `MAY_IMPORT` says.  "" is what lies beside the rooms, in the package's own folder.
HOUSE: dict[str, tuple[str, ...]] = {
    "multibody": (
        "base",
        "declare",
        "equations",
        "model",
        "assembly",
        "inputs",
        "compile",
        "solvers",
        "system",
        "fmi",
        "machine",
        "library",
        "",
    ),
    "surrogate": ("",),
    "estimation": ("files", "signals", "response", "fit", "filters", ""),
    "discrepancy": (
        "statistics",
        "drawing",
        "effects",
        "problem",
        "residual",
        "innovations",
        "sensitivities",
        "stages",
        "search",
        "evidence",
        "questions",
        "conclusion",
        "report",
        "study",
        "starters",
        "workbench",
        "rigs",
        "validation",
        "",
    ),
    "operation": ("statistics", "store", "sources", "follow", "fleet", "page", ""),
    "vtsdt": ("files", "parts", "lift", "rig", "alignment", "whatif", "papers", "fleet", "cli", ""),
    "gearbox": ("files", "signals", "parts", "stage", "rig", "updating", "papers", ""),
}
PACKAGES = tuple(HOUSE)
GROUND = {"multibody", "estimation", "surrogate", "discrepancy", "operation"}
MAY_IMPORT: dict[str, set[str]] = {
    "multibody": set(),
    "surrogate": set(),
    "estimation": {"multibody"},
    "discrepancy": {"estimation", "multibody"},
    "operation": {"discrepancy", "estimation", "multibody"},
    "vtsdt": GROUND,
    "gearbox": GROUND,
}
HEAVY = ("numba", "scipy", "pandas", "matplotlib", "pint", "jinja2", "rich", "pyarrow", "fmpy")


def _files() -> dict[str, Path]:
    """Path of each module of the packages by dotted name; a package stands for its ``__init__``."""
    files = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return files


FILES = _files()


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
    named = {f"{base}.{alias.name}" for alias in node.names} & files.keys()
    others = any(f"{base}.{alias.name}" not in files for alias in node.names)
    return named | ({base} & files.keys() if others else set())


def _graph(files: dict[str, Path]) -> dict[str, set[str]]:
    """Who imports whom, by any kind of import: at the top, inside functions, under TYPE_CHECKING."""
    graph = {}
    for module, path in files.items():
        tree = ast.parse(path.read_text(encoding="utf-8"), str(path))
        nodes = (n for n in ast.walk(tree) if isinstance(n, ast.Import | ast.ImportFrom))
        graph[module] = {t for node in nodes for t in _targets(module, node, files)} - {module}
    return graph


def _room(module: str, files: dict[str, Path]) -> str:
    """The folder of a module inside its package; "" where it lies beside the rooms."""
    parts = module.split(".")
    is_folder = files[module].name == "__init__.py"
    return parts[1] if len(parts) > 2 or (len(parts) == 2 and is_folder) else ""


def _wrong_arrows(files: dict[str, Path]) -> list[str]:
    wrong = []
    for module, targets in _graph(files).items():
        package, room = module.split(".")[0], _room(module, files)
        for target in sorted(targets):
            other = target.split(".")[0]
            if other == package:
                rooms = HOUSE[package]
                allowed = rooms.index(_room(target, files)) <= rooms.index(room)
            else:
                # The command line calls each package's own subcommand when it is asked for it.
                allowed = other in MAY_IMPORT[package] or module.startswith("vtsdt.cli.")
            if not allowed:
                wrong.append(f"{module} imports {target}")
    return wrong


def _circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Groups of modules that reach each other."""

    def reached(start: str) -> set[str]:
        seen: set[str] = set()
        waiting = [start]
        while waiting:
            new = graph[waiting.pop()] - seen
            seen |= new
            waiting += new
        return seen

    reach = {module: reached(module) for module in graph}
    groups = {frozenset(o for o in reach[m] if m in reach[o]) for m in graph if m in reach[m]}
    return sorted(sorted(group) for group in groups)


def test_every_room_is_on_the_plan() -> None:
    rooms = {(m.split(".")[0], _room(m, FILES)) for m in FILES}
    assert rooms == {(package, room) for package, rooms in HOUSE.items() for room in rooms}


def test_arrows_run_one_way() -> None:
    assert _wrong_arrows(FILES) == []


def test_no_circles_between_files_by_any_kind_of_import() -> None:
    assert _circles(_graph(FILES)) == []


def test_the_import_check_sees_what_it_forbids(tmp_path: Path) -> None:
    """The tests above must not pass because nothing was parsed."""
    sources = {
        "multibody": "",
        "multibody.base": "from .errors import f\n",
        "multibody.base.errors": "import numpy\ndef f():\n    from estimation.files.records import read\n",
        "multibody.model": "",
        "multibody.model.graph": "from multibody.base import f\nif TYPE_CHECKING:\n    from . import network\n",
        "multibody.model.network": "def g():\n    import multibody.model.graph\n    import multibody.system.system\n",
        "multibody.system": "",
        "multibody.system.system": "from multibody.model.network import g\n",
        "estimation.files.records": "from multibody import f\n",
        "vtsdt.cli.command_line": "def main():\n    import gearbox.updating.command\n",
        "vtsdt.lift.lift": "from gearbox.updating import command\n",
        "gearbox.updating.command": "",
    }
    files = {}
    for module, text in sources.items():
        folders = ("multibody", "multibody.base", "multibody.model", "multibody.system")
        name = "__init__" if module in folders else "file"
        files[module] = tmp_path / module / f"{name}.py"
        files[module].parent.mkdir()
        files[module].write_text(text)
    assert _wrong_arrows(files) == [
        "multibody.base.errors imports estimation.files.records",
        "multibody.model.network imports multibody.system.system",
        "vtsdt.lift.lift imports gearbox.updating.command",
    ]
    assert _circles(_graph(files)) == [
        ["multibody.model.graph", "multibody.model.network", "multibody.system.system"],
    ]


def _listed(path: Path) -> list[str]:
    """Names in the ``__all__`` of a file."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__":
            return [str(each.value) for each in ast.walk(node.value) if isinstance(each, ast.Constant)]
    return []


def test_no_public_name_is_dead() -> None:
    """What a file lists in ``__all__`` is used in another file: of the packages, of the tests, or of the docs."""
    patterns = ("*.py", "*.pyi", "*.md", "*.toml", "*.html")
    folders = (*PACKAGES, "tests", "docs", "examples", "benchmarks")
    others = [path for folder in folders for pattern in patterns for path in (ROOT / folder).rglob(pattern)]
    users: dict[str, set[Path]] = {}
    for path in others:
        for word in set(re.findall(r"\w+", path.read_text(encoding="utf-8"))):
            users.setdefault(word, set()).add(path)
    files = [path for path in FILES.values() if path.name != "__init__.py"]
    listed = [(path, name) for path in files for name in _listed(path)]
    assert len(listed) > 100
    assert [f"{path.relative_to(ROOT)}: {name}" for path, name in listed if users[name] == {path}] == []


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


#: What declares a component is a small language of its own: default, unit and meaning stand by position.
DECLARATIONS = "multibody/declare/declarations.py"
BY_POSITION = 4


def _by_position(path: Path) -> Iterator[str]:
    """Dataclasses of more than four fields that take more than two of them by position."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.ClassDef):
            continue
        decorators = [ast.unparse(decorator) for decorator in node.decorator_list]
        if not any(text.split("(")[0].split(".")[-1] == "dataclass" for text in decorators):
            continue
        fields = [f for f in node.body if isinstance(f, ast.AnnAssign) and "ClassVar" not in ast.unparse(f.annotation)]
        taken = [(ast.unparse(f.annotation), ast.unparse(f.value) if f.value else "") for f in fields]
        taken = [(kind, value) for kind, value in taken if "init=False" not in value]
        kinds = [kind.split(".")[-1] for kind, _ in taken]
        first = taken[: kinds.index("KW_ONLY")] if "KW_ONLY" in kinds else taken
        positional = [value for _, value in first if "kw_only=True" not in value]
        if len(taken) > BY_POSITION and len(positional) > 2 and "kw_only=True" not in " ".join(decorators):
            yield f"{path.name}:{node.lineno}: {node.name} takes {len(positional)} fields by position"


def test_values_of_more_than_four_fields_are_made_by_keyword() -> None:
    """At most two leading fields, such as the samples of a signal and their rate, may stand by position."""
    paths = [path for path in FILES.values() if path != ROOT / DECLARATIONS]
    assert [line for path in paths for line in _by_position(path)] == []


def test_the_check_of_keywords_sees_what_it_forbids(tmp_path: Path) -> None:
    fields = "".join(f"    {name}: float\n" for name in "abcde")
    path = tmp_path / "values.py"
    path.write_text(
        f"@dataclass(frozen=True)\nclass A:\n{fields}\n"
        f"@dataclass(kw_only=True)\nclass B:\n{fields}\n"
        f"@dataclasses.dataclass\nclass C:\n{fields}\n"
        f"@dataclass\nclass D:\n    x: float\n    _: KW_ONLY\n{fields}\n"
    )
    assert list(_by_position(path)) == [
        "values.py:2: A takes 5 fields by position",
        "values.py:18: C takes 5 fields by position",
    ]


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
    readers = [name for extra in re.findall(r"\w+", extras["readers"][0].split("[")[1]) for name in extras[extra]]
    tests = [name for name in extras["test"] if not name.startswith("vtsdt[")]
    assert [name for name in extras["test"] if name not in tests] == [
        "vtsdt[readers,workbench,browser,mqtt,notebooks,fmi]"
    ]
    tests += [name for extra in ("workbench", "browser", "mqtt", "notebooks") for name in extras[extra]]
    wanted = [*project["dependencies"], *tests, *readers, *extras["lint"], *extras["docs"]]
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


def test_the_paths_that_contributing_gives_exist() -> None:
    paths = re.findall(r"`([\w./-]+/[\w.-]+\.(?:py|md))`", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"))
    assert len(paths) > 10
    assert [path for path in paths if not (ROOT / path).is_file()] == []


def test_the_paths_to_a_decision_are_short_and_follow_the_imports() -> None:
    """Each file of a path is imported by one before it, so that a reader who follows them meets no others."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    paths = re.findall(r"\| [^|]* \| decides \|\n\| --- \| --- \|\n((?:\|.*\n)+)", text)
    assert len(paths) == 2
    graph = _graph(FILES)
    for path in paths:
        files = re.findall(r"^\| `([\w/]+)\.py`", path, re.MULTILINE)
        modules = [file.replace("/", ".") for file in files]
        assert modules[0] == "discrepancy.study.study"
        assert len(modules) == path.count("\n") <= 6
        reached = graph[modules[0]]
        for module in modules[1:]:
            assert module in reached, f"no file before {module} imports it"
            reached = reached | graph[module]


def test_the_values_between_a_column_and_the_sentence_are_few_and_exist() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    passage = text[text.index("From the column of a file") : text.index("The report, the figures")]
    values = re.findall(r"`(\w+)`", passage)
    code = "\n".join(path.read_text(encoding="utf-8") for path in FILES.values())
    assert passage.count("→") + 1 == len(values) <= 8
    assert [value for value in values if not re.search(rf"^class {value}\b", code, re.MULTILINE)] == []
