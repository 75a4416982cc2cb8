"""``vtsdt export-fmu``: a model as a Functional Mock-up Unit for other tools."""

from __future__ import annotations

import importlib
import importlib.util
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from multibody.fmi.export import FMI_VERSIONS
from vtsdt.cli.arguments import CommandError, Parser

__all__ = ["main"]


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt export-fmu``."""
    parser = Parser(
        prog="vtsdt export-fmu",
        description=(
            "Write a model as an FMU for Model Exchange and Co-Simulation, with its C source and, where a C compiler "
            "is found, a library for this platform."
        ),
    )
    add = parser.add_argument
    add(
        "model",
        metavar="MODEL",
        help="model.json or stages/K.json (a diagnosis writes them, with the effects found), a study file, "
        "FILE.py:NAME of a function that returns a model, or a shipped model: lift, lift-1d, lift-cabin, axis, gear",
    )
    add("--out", metavar="FILE.fmu", required=True, help="the file to be written")
    add("--fmi", choices=FMI_VERSIONS, default="3.0", help="version of the standard (default 3.0)")
    add("--at-equilibrium", action="store_true", help="start at rest, near the model's start values")
    add(
        "--reference",
        metavar="FILE.csv|SECONDS",
        help="put reference results beside the unit (FMI-LS-REF): of a run with the inputs of this table (a column "
        "'time' in s, and inputs by their names in SI), or for so many seconds with inputs at their start values",
    )
    add("--source-only", action="store_true", help="without a library for this platform; needs no C compiler")
    add("--quiet", action="store_true", help="say nothing")
    args = parser.parse_args(list(arguments))
    system = _model(args.model).build()
    initial = system.equilibrium().to_dict() if args.at_equilibrium and args.reference else None
    out = system.to_fmu(
        args.out,
        fmi_version=args.fmi,
        at_equilibrium=args.at_equilibrium and initial is None,
        binary=False if args.source_only else None,
        reference=_reference(system, args.reference, initial) if args.reference else None,
    )
    if not args.quiet:
        print(f"{out}: FMI {args.fmi}, {_contents(out)}")
    return 0


def _reference(system: Any, given: str, initial: Any) -> Any:
    """Return the run that the user asks for: over a table of inputs, or for a number of seconds."""
    try:
        seconds = float(given)
    except ValueError:
        pass
    else:
        if not 0.0 < seconds < math.inf:
            raise CommandError(f"--reference {given}: give a positive number of seconds, or a CSV file")
        return system.simulate(seconds, inputs={q.name: q.value for q in system.inputs}, initial=initial)
    from estimation.files.read_table import read_table
    from estimation.files.table import TableRequest

    path = Path(given)
    if not path.is_file():
        raise CommandError(f"--reference: there is no file '{given}', and it is no number of seconds")
    wanted = TableRequest(columns=("time", *system.input_names), optional=frozenset(system.input_names), time="time")
    numbers = read_table(path, wanted).numbers
    times = numbers["time"]
    if times.size < 2 or not np.all(np.diff(times) > 0.0):
        raise CommandError(f"--reference {path.name}: the column 'time' must increase, over two rows or more")
    inputs = {name: (times, numbers[name]) for name in system.input_names if name in numbers}
    return system.simulate((float(times[0]), float(times[-1])), times=times, inputs=inputs, initial=initial)


def _contents(out: Path) -> str:
    import zipfile

    with zipfile.ZipFile(out) as file:
        folders = [name.split("/")[1] for name in file.namelist() if name.startswith("binaries/")]
        beside = " and reference results" if any(name.startswith("extra/") for name in file.namelist()) else ""
    if folders:
        return f"source{',' if beside else ' and'} a library for {folders[0]}{beside}"
    return f"source alone{beside}: compile it where it is to run"


def _model(text: str) -> Any:
    """Return the model that the user names."""
    from vtsdt.cli.warm import MODELS, shipped

    if text in MODELS:
        return shipped(text)
    path = Path(text)
    if path.suffix in (".json", ".toml") and not path.is_file():
        raise CommandError(f"there is no file '{text}'")
    if path.is_dir():
        raise CommandError(f"'{text}' is a folder: name model.json or stages/K.json in it")
    if path.suffix == ".json":
        from multibody.machine.model import Model

        return Model.load(path)
    if path.suffix == ".toml":
        from discrepancy.problem.model import load_model
        from discrepancy.problem.study_file import read_study

        return load_model(read_study(path))
    source, _, name = text.rpartition(":")
    if not source.endswith(".py") or not Path(source).is_file():
        raise CommandError(
            f"'{text}' is no model: name a model.json, a study file, FILE.py:NAME, or one of {', '.join(MODELS)}"
        )
    spec = importlib.util.spec_from_file_location(Path(source).stem, source)
    if spec is None or spec.loader is None:
        raise CommandError(f"'{source}' cannot be imported")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    if not callable(builder := getattr(module, name, None)):
        raise CommandError(f"'{source}' has no function '{name}'")
    return builder()
