"""Models in files: JSON with the components' classes by name, and their values in SI.

A class of this package or of an installed one is written ``module:Class``.  A user's own class is written
``file.py:Class`` with the path relative to the model file; loading it runs that file, as importing it would.
"""

from __future__ import annotations

import dataclasses
import importlib
import importlib.util
import json
import os
import re
import sys
import sysconfig
from collections.abc import Callable, Iterable
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from multibody.base.errors import ModelError
from multibody.base.json_file import write_json_atomically
from multibody.base.references import EFFECTS_GROUP, MODELS_GROUP, OWN, is_in_offered, is_offered, module_named
from multibody.base.spelling import nearest
from multibody.declare.component import Component
from multibody.model.graph import ModelGraph, ModelInput

__all__ = ["SCHEMA", "load", "save"]

SCHEMA = 1
_TOP = {"schema": int, "name": str, "components": dict, "connections": list, "inputs": list, "outputs": dict}
M = TypeVar("M", bound=ModelGraph)

_PARTS = ("values", "options", "units", "tables", "starts")


def save(model: ModelGraph, path: str | Path) -> Path:
    """Write a model as JSON and return the path.

    Raises
    ------
    ModelError
        If a component has faults, or its class is not at the top of a module that can be imported again.
    """
    path = Path(path)
    faults = list(model.declared_faults)
    components = {}
    for name, component in model.components.items():
        faults += [f"component '{name}': {fault}" for fault in component.faults]
        try:
            reference = _reference(type(component), path.resolve().parent)
        except LookupError as error:
            faults.append(f"component '{name}': {error}")
            continue
        entry: dict[str, Any] = {"class": reference}
        for part in ("values", "options", "units", "starts"):
            if values := getattr(component, part):
                entry[part] = values
        if component.tables:
            entry["tables"] = {k: {"x": x.tolist(), "y": y.tolist()} for k, (x, y) in component.tables.items()}
        components[name] = entry
    if faults:
        raise ModelError(model.name, faults)
    inputs = [{k: v for k, v in dataclasses.asdict(entry).items() if v is not None} for entry in model.inputs.values()]
    content = {
        "schema": SCHEMA,
        "name": model.name,
        "components": components,
        "connections": model.connections,
        "inputs": inputs,
        "outputs": model.outputs,
    }
    return write_json_atomically(path, content)


def load(path: str | Path, model_class: Callable[[str], M]) -> M:
    """Read a model from a file written by `save`.

    Parameters
    ----------
    path : str or Path
    model_class : callable
        Returns an empty model with the name it is given, such as `Model`.

    Raises
    ------
    ModelError
        With every fault of the file: broken JSON with line and column, unknown schema, missing or unknown
        entries, classes and files that cannot be found, values that do not fit.
    OSError
        If the file cannot be read.
    """
    path = Path(path)
    faults: list[str] = []
    content = _read(path, faults)
    model = model_class(str(content.get("name", path.stem)))
    for name, entry in content["components"].items():
        component = _component(name, entry, path.resolve().parent, faults)
        if component is not None:
            model.add(name, component)
            faults += [f"component '{name}': {fault}" for fault in component.faults]
    for k, ends in enumerate(content["connections"]):
        if isinstance(ends, list) and ends and all(isinstance(e, str) for e in ends):
            model.connect(*ends)
        else:
            faults.append(f'connection {k} has to be a list of endpoints such as ["spring.a", "ground"]')
    for k, entry in enumerate(content["inputs"]):
        _input(model, k, entry, faults)
    for name, source in content["outputs"].items():
        if isinstance(source, str):
            model.output(name, source)
        else:
            faults.append(f"output '{name}' has to name a quantity such as \"spring.tension\"")
    if faults:
        raise ModelError(f"{path}", faults)
    return model


def _read(path: Path, faults: list[str]) -> dict[str, Any]:
    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        keys = [key for key, _ in pairs]
        faults.extend(f"'{key}' appears twice in one object" for key in sorted({k for k in keys if keys.count(k) > 1}))
        return dict(pairs)

    def refuse(word: str) -> float:
        raise ModelError(f"{path}", [f"{word} is not a number that a model can have"])

    try:
        text = path.read_text(encoding="utf-8")
        content = json.loads(text, object_pairs_hook=unique, parse_constant=refuse)
    except UnicodeDecodeError as error:
        raise ModelError(f"{path}", [f"the file is not UTF-8 text (byte {error.start})"]) from error
    except json.JSONDecodeError as error:
        where = f"line {error.lineno}, column {error.colno}"
        raise ModelError(f"{path}", [f"the file is not JSON: {error.msg} at {where}"]) from error
    if not isinstance(content, dict) or "schema" not in content:
        raise ModelError(f"{path}", ["this is not a model file: it has no entry 'schema'"])
    if not faults and not {"components", "connections"} & content.keys():
        raise ModelError(
            f"{path}", ["this is not a model file: a diagnosis writes its models as model.json and stages/K.json"]
        )
    if content["schema"] != SCHEMA:
        mismatch = f"the file has schema {content['schema']!r}, this version reads {SCHEMA}: "
        newer = isinstance(content["schema"], int) and content["schema"] > SCHEMA
        raise ModelError(f"{path}", [mismatch + ("update the package" if newer else "save the model again")])
    for key, kind in _TOP.items():
        if key not in content:
            faults.append(f"the entry '{key}' is missing")
        elif not isinstance(content[key], kind):
            faults.append(f"the entry '{key}' has to be a {kind.__name__}, it is a {type(content[key]).__name__}")
    # a model among the results of a run says of which
    faults += [f"unknown entry '{key}'{nearest(key, _TOP)}" for key in content if key not in (*_TOP, "run")]
    if faults:
        raise ModelError(f"{path}", faults)
    return content


def _component(name: str, entry: Any, folder: Path, faults: list[str]) -> Component | None:
    where = f"component '{name}'"
    if not isinstance(entry, dict) or not isinstance(entry.get("class"), str):
        faults.append(f"{where}: give an object with 'class', such as \"multibody.library:Mass\"")
        return None
    faults += [f"{where}: unknown entry '{k}'{nearest(k, _PARTS)}" for k in entry if k not in (*_PARTS, "class")]
    given: dict[str, Any] = {}
    for part in _PARTS:
        values = entry.get(part, {})
        if not isinstance(values, dict):
            faults.append(f"{where}: '{part}' has to be an object of names and values")
            continue
        for key, value in values.items():
            if part == "tables":
                if not isinstance(value, dict) or set(value) != {"x", "y"}:
                    faults.append(f'{where}: table \'{key}\' has to be {{"x": [...], "y": [...]}}')
                    continue
                value = (value["x"], value["y"])
            elif part in ("values", "starts") and (isinstance(value, bool) or not isinstance(value, int | float)):
                faults.append(f"{where}: '{key}' has to be a number in SI, it is {value!r}")
                continue
            given[key] = value
    try:
        cls = _class(entry["class"], folder)
        return cls(**given)
    except LookupError as error:
        faults.append(f"{where}: {error.args[0]}")
    except Exception as error:
        faults.append(f"{where}: {entry['class']} could not be made: {type(error).__name__}: {error}")
    return None


def _input(model: ModelGraph, k: int, entry: Any, faults: list[str]) -> None:
    known = {f.name for f in dataclasses.fields(ModelInput)}
    if not isinstance(entry, dict) or not isinstance(entry.get("name"), str):
        faults.append(f"input {k} has to be an object with 'name' and 'targets'")
        return
    name, targets = entry["name"], entry.get("targets")
    if not isinstance(targets, list) or not all(isinstance(t, str) for t in targets):
        faults.append(f"input '{name}': 'targets' has to be a list of component inputs")
        return
    faults += [f"input '{name}': unknown entry '{key}'{nearest(key, known)}" for key in entry if key not in known]
    numbers = {key: entry[key] for key in ("default", "gain", "offset", "delay") if key in entry}
    for key, value in numbers.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            faults.append(f"input '{name}': '{key}' has to be a number in SI, it is {value!r}")
            return
    model.input(name, *targets, default=numbers.pop("default", None))
    for key, value in numbers.items():
        setattr(model.inputs[name], key, float(value))


# -------------------------------------------------------------------- classes by name


def _reference(cls: type, folder: Path) -> str:
    module = sys.modules.get(cls.__module__)
    if "." in cls.__qualname__ or getattr(module, cls.__qualname__, None) is not cls:
        raise LookupError(f"class {cls.__qualname__} is not at the top of a module: move it there to save the model")
    file = getattr(module, "__file__", None)
    if file is None:
        raise LookupError(f"class {cls.__qualname__} is not in a file: define it in one to save the model")
    if _installed(cls.__module__, Path(file).resolve()):
        return f"{cls.__module__}:{cls.__qualname__}"
    try:
        relative = os.path.relpath(Path(file).resolve(), folder)
    except ValueError:  # another drive
        relative = str(Path(file).resolve())
    return f"{Path(relative).as_posix()}:{cls.__qualname__}"


def _installed(module: str, file: Path) -> bool:
    """Tell whether a module can be imported by its name: part of this distribution or of an installed one."""
    home = Path(__file__).resolve().parents[2]
    if module.split(".")[0] in OWN:
        return file.is_relative_to(home)
    if is_in_offered(module):
        return True
    paths = {Path(sysconfig.get_path(key)).resolve() for key in ("purelib", "platlib", "stdlib")}
    return any(file.is_relative_to(p) for p in paths)


def _class(reference: str, folder: Path) -> type[Component]:
    place, colon, name = reference.rpartition(":")
    if not colon or not name.isidentifier():
        raise LookupError(f'class \'{reference}\' has to be written "module:Class" or "file.py:Class"')
    module = _file_module(folder / place) if place.endswith(".py") else _named_module(place)
    cls = getattr(module, name, None)
    if not isinstance(cls, type) or not issubclass(cls, Component):
        known = [k for k, v in vars(module).items() if isinstance(v, type) and issubclass(v, Component)]
        raise LookupError(f"'{place}' has no component class '{name}'{nearest(name, known)}")
    return cls


def _named_module(name: str) -> ModuleType:
    if not re.fullmatch(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*", name):
        raise LookupError(f"'{name}' is neither the name of a module nor a file ending in .py")
    if not is_offered(name):
        raise LookupError(
            f"module '{name}' is not imported because a file names it: import it before you load the model, or let its "
            f"package offer it by an entry point of the group '{MODELS_GROUP}' or '{EFFECTS_GROUP}'"
        )
    try:
        return module_named(name)
    except ImportError as error:
        raise LookupError(f"module '{name}' cannot be imported ({error}): install the package it belongs to") from error


def _file_module(path: Path) -> ModuleType:
    path = path.resolve()
    if not path.is_file():
        raise LookupError(f"the file '{path}' is needed for its component classes and does not exist: restore it")
    for module in _modules_of(path):
        return module
    spec = importlib.util.spec_from_file_location(f"vtsdt_file_{path.stem}_{len(sys.modules)}", path)
    if spec is None or spec.loader is None:
        raise LookupError(f"the file '{path}' cannot be read as Python")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[spec.name]
        raise LookupError(f"running '{path}' failed: {type(error).__name__}: {error}") from error
    return module


def _modules_of(path: Path) -> Iterable[ModuleType]:
    """Return modules already loaded from a file, so that its classes stay the same classes."""
    for module in list(sys.modules.values()):
        file = getattr(module, "__file__", None)
        if isinstance(file, str) and file.endswith(path.name) and Path(file).resolve() == path:
            yield module
