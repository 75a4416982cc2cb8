"""Building a study's model, and checking the study's names against it."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import os
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from discrepancy.problem.fmu_model import fmu_model
from discrepancy.problem.study_file import StudyError, StudyFile
from estimation.files.column_names import pint_unit, to_si
from multibody.base.references import MODELS_GROUP, OWN, module_named, offered_modules
from multibody.base.spelling import nearest_or_choices
from multibody.base.units import UnitError

__all__ = ["check_names", "load_model"]


@contextmanager
def _import_from(folder: Path) -> Iterator[None]:
    """Let the builder import the other files of its folder; a working directory that it changes is restored."""
    sys.path.insert(0, str(folder))
    working = os.getcwd()
    try:
        yield
    finally:
        if os.getcwd() != working:
            os.chdir(working)
        if str(folder) in sys.path:
            sys.path.remove(str(folder))


def _user_error(error: BaseException, study: StudyFile, doing: str) -> StudyError:
    """Return an error that names the place in the user's own files where it arose."""
    if isinstance(error, SyntaxError) and error.filename:
        place = f"{Path(error.filename).name}, line {error.lineno}"
    else:
        frames = traceback.extract_tb(error.__traceback__)
        own = [frame for frame in frames if not frame.filename.startswith("<frozen") and frame.filename != __file__]
        in_folder = [frame for frame in own if Path(frame.filename).is_relative_to(study.path.parent)]
        last = (in_folder or own or list(frames))[-1]
        place = f"{Path(last.filename).name}, line {last.lineno}, in {last.name}"
    name = type(error).__name__
    text = str(error.msg) if isinstance(error, SyntaxError) else str(error)
    where = f'{study.path.name}, [model] build = "{study.model.build}"'
    return StudyError([f"{where}: {doing}: {place}: {name}: {text}: correct it there"])


#: Modules of this distribution that have builders for studies.
BUILDERS = ("vtsdt.lift", "vtsdt.rig.models", "gearbox.stage", "gearbox.rig.encoders")


def _module(study: StudyFile, source: str) -> ModuleType:
    folder = study.path.parent.resolve()
    if not source.endswith(".py"):
        return _named_module(study, source)
    file = (folder / source).resolve()
    if not file.is_relative_to(folder):
        raise StudyError(
            [
                f"{study.path.name}, [model] build: '{source}' is not beside the study: a study runs only files of its "
                "own folder; copy the file there"
            ]
        )
    # Two studies may both have an axis.py: the folder makes the module's name unique.
    name = f"_study_{hashlib.sha256(str(file).encode()).hexdigest()[:12]}_{file.stem}"
    spec = importlib.util.spec_from_file_location(name, file)
    if spec is None or spec.loader is None:
        raise ImportError(f"'{file.name}' cannot be imported")
    module = importlib.util.module_from_spec(spec)
    # Dataclasses and numba look their module up while it is still being executed.
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _named_module(study: StudyFile, name: str) -> ModuleType:
    """Import a module beside the study, one of this distribution that has builders, or one that is offered."""
    folder = study.path.parent.resolve()
    where = f"{study.path.name}, [model] build"
    top = name.partition(".")[0]
    if (folder / f"{top}.py").is_file() or (folder / top).is_dir():
        module = importlib.import_module(name)
        places = [getattr(module, "__file__", None), *getattr(module, "__path__", ())]
        if not any(place and Path(place).resolve().is_relative_to(folder) for place in places):
            raise StudyError(
                [f"{where}: another module '{top}' is imported already: give the one beside the study another name"]
            )
        return module
    if top in OWN:
        module = module_named(name)
        if module.__name__ not in BUILDERS:
            raise StudyError([f"{where}: '{name}' has no models for studies{nearest_or_choices(name, BUILDERS)}"])
        return module
    if any(name == offered or name.startswith(f"{offered}.") for offered in offered_modules()):
        return module_named(name)
    known = [*BUILDERS, *offered_modules()]
    raise StudyError(
        [
            f"{where}: there is no module '{name}' beside the study or offered by an installed package: name a file as "
            f"\"file.py:name\", or let the package say in its entry points, group '{MODELS_GROUP}', that it has models"
            f"{nearest_or_choices(name, known, lead='; nearest of those that do: ')}"
        ]
    )


def load_builder(study: StudyFile) -> Callable[..., Any]:
    """Import the callable that ``[model] build`` names.

    Raises
    ------
    StudyError
        If the file or module cannot be imported or has no such callable.
    """
    source, _, name = study.model.build.rpartition(":")
    where = f"{study.path.name}, [model] build"
    with _import_from(study.path.parent):
        try:
            module = _module(study, source)
        except StudyError:
            raise
        except (Exception, SystemExit) as error:
            raise _user_error(error, study, "the import fails") from error
    builder = getattr(module, name, None)
    if builder is None:
        own = [key for key, value in vars(module).items() if callable(value) and not key.startswith("_")]
        hint = nearest_or_choices(name, own) if own else f": write 'def {name}()' in it, which returns the model"
        raise StudyError([f"{where}: '{source}' has no '{name}'{hint}"])
    if not callable(builder):
        raise StudyError([f"{where}: '{name}' in '{source}' is {type(builder).__name__} and not callable"])
    beside = Path(getattr(module, "__file__", None) or "").resolve().is_relative_to(study.path.parent.resolve())
    package = str(getattr(builder, "__module__", "")).partition(".")[0]
    if not beside and package != source.partition(".")[0]:
        raise StudyError([f"{where}: '{name}' in '{source}' comes from '{package}': it is no builder of that package"])
    return builder  # type: ignore[no-any-return]


def load_model(study: StudyFile, kind: type | None = None) -> Any:
    """Build the study's model.

    Parameters
    ----------
    study : StudyFile
    kind : type, optional
        What the builder must return.

    Raises
    ------
    StudyError
        If the builder cannot be found, its arguments do not fit, it fails, or it returns something else.
    """
    if study.model.fmu:
        return fmu_model(study)
    builder = load_builder(study)
    if faults := _argument_faults(study, builder):
        raise StudyError(faults)
    with _import_from(study.path.parent):
        try:
            model = builder(**study.model.arguments)
        except (Exception, SystemExit) as error:
            raise _user_error(error, study, "the builder fails") from error
    if model is None or (kind is not None and not isinstance(model, kind)):
        wanted = "a model" if kind is None else f"a {kind.__name__}"
        got = "None: does it end with 'return model'?" if model is None else f"a {type(model).__name__}"
        raise StudyError([f'{study.path.name}, [model] build = "{study.model.build}": must return {wanted}, got {got}'])
    return model


def _argument_faults(study: StudyFile, builder: Callable[..., Any]) -> list[str]:
    where = f"{study.path.name}, [model] arguments"
    try:
        parameters = inspect.signature(builder).parameters
    except (TypeError, ValueError):  # some builtins and extension types have no signature
        return []
    by_name = {
        name: parameter
        for name, parameter in parameters.items()
        if parameter.kind in (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    }
    takes_any = any(parameter.kind is inspect.Parameter.VAR_KEYWORD for parameter in parameters.values())
    faults = []
    for name in study.model.arguments:
        if name not in by_name and not takes_any:
            faults.append(
                f"{where}: '{study.model.build}' takes no argument '{name}'{nearest_or_choices(name, by_name)}"
            )
    for name, parameter in by_name.items():
        if parameter.default is inspect.Parameter.empty and name not in study.model.arguments:
            faults.append(f"{where}: '{study.model.build}' needs the argument '{name}'")
    return faults


def _units(names: Iterable[str] | Mapping[str, str]) -> dict[str, str | None]:
    return dict(names) if isinstance(names, Mapping) else dict.fromkeys(names)


def check_names(
    study: StudyFile,
    parameters: Iterable[str] | Mapping[str, str],
    inputs: Iterable[str] | Mapping[str, str],
    outputs: Iterable[str] | Mapping[str, str],
    states: Iterable[str] | Mapping[str, str],
) -> tuple[str, ...]:
    """Compare the names and units of a study with those of its model.

    Parameters
    ----------
    study : StudyFile
    parameters, inputs, outputs, states : mapping of str to str, or names only
        The model's names with their SI units.

    Returns
    -------
    tuple of str
        One sentence for each fault; empty if there is none.
    """
    file = study.path.name
    kinds = {
        "parameter": _units(parameters),
        "input": _units(inputs),
        "output": _units(outputs),
        "state": _units(states),
    }
    faults = []

    def look_up(table: str, names: Iterable[str], kind: str) -> None:
        for name in names:
            if name in kinds[kind]:
                continue
            elsewhere = next((other for other, known in kinds.items() if name in known), None)
            hint = nearest_or_choices(name, kinds[kind])
            if elsewhere:
                hint = f"; it is a {elsewhere} of the model: name a {kind} here{hint}"
            hint = hint.replace("a input", "an input").replace("a output", "an output")
            faults.append(f"{file}, {table}: the model has no {kind} '{name}'{hint}")

    look_up("[uncertain]", study.uncertain, "parameter")
    look_up("[inputs]", study.inputs, "input")
    look_up("[outputs]", study.outputs, "output")
    look_up("[initial]", [*study.initial.values, *study.initial.free], "state")
    for name, value in study.initial.values.items():
        if "measured" in (value.values() if isinstance(value, Mapping) else [value]) and name not in study.outputs:
            hint = nearest_or_choices(name, study.outputs)
            faults.append(f'{file}, [initial] "{name}": "measured" needs an output of this name in [outputs]{hint}')
    for table, entries, kind in (("inputs", study.inputs, "input"), ("outputs", study.outputs, "output")):
        for name, column in entries.items():
            unit = kinds[kind].get(name)
            if unit is None or column.unit is None:
                continue
            try:
                to_si(np.zeros(1), pint_unit(column.unit), unit)
            except UnitError as error:
                faults.append(f"{file}, [{table}] \"{name}\", unit: {error}; the model's {kind} is in '{unit}'")
    return tuple(faults)
