"""``vtsdt bench lift``: recordings of a virtual lift as a rig would write them, with effects hidden in it."""

from __future__ import annotations

import dataclasses
import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from discrepancy.rigs.recording import Disturbance, Logger, check_folder, write_json
from discrepancy.rigs.rig import write_case
from multibody.base.progress import Progress, silent
from vtsdt.files.parameters import LiftParameters
from vtsdt.rig import texts as bench_texts
from vtsdt.rig.models import MODELS
from vtsdt.rig.rails import RailSpectrum
from vtsdt.rig.rig import LiftRig

__all__ = ["drawn_spectrum", "main", "make_configurations", "make_lift"]


def make_lift(
    out: str | os.PathLike[str],
    hide: Sequence[str] = (),
    *,
    rig: LiftRig | None = None,
    parameter_file: str | None = None,
    command: str = "",
    progress: Progress = silent,
    **settings: Any,
) -> Path:
    """Write recordings of the virtual lift into a folder, with the study file and the truth.

    Parameters
    ----------
    out : path
        Folder; made if it is not there.
    hide : sequence of str
        ``KIND`` or ``KIND@WHERE``.
    rig : LiftRig, optional
        All settings at once; otherwise ``settings`` go to `LiftRig`.
    parameter_file : str, optional
        A lift of one's own; default: the shipped bench.
    command : str
        Said in the README.

    Returns
    -------
    Path
        The study file.

    Raises
    ------
    BenchError
        With everything that is not possible.
    """
    if Path(out).is_file():
        check_folder(out)
    if rig is None:
        if parameter_file is not None:
            settings["parameters"] = LiftParameters.load(parameter_file)
        rig = LiftRig(**settings)
    case = rig.case(hide, progress)
    own = parameter_file is not None
    texts = {
        "study.toml": bench_texts.study(rig, case, own),
        "README.md": bench_texts.readme(rig, case, command or f"vtsdt bench lift --seed {rig.seed}"),
    }
    if own:
        texts["lift.py"] = bench_texts.BUILDER
    study = write_case(out, case, texts)
    if parameter_file is not None:
        shutil.copyfile(parameter_file, study.with_name("lift.toml"))
    return study


def drawn_spectrum(rig: LiftRig) -> RailSpectrum:
    """Return how badly the guides of a configuration are set: mean 1.4 to 2.6 mm, unevenness 0.2 to 0.6 mm."""
    rng = rig.stream(4)
    return RailSpectrum(mean=float(rng.uniform(1.4e-3, 2.6e-3)), rms_x=float(rng.uniform(0.2e-3, 0.6e-3)))


def make_configurations(
    out: str | os.PathLike[str],
    count: int = 14,
    hide: Sequence[str] = (),
    *,
    rig: LiftRig | None = None,
    parameter_file: str | None = None,
    command: str = "",
    progress: Progress = silent,
) -> list[Path]:
    """Write recordings of one lift whose guides were set several times, each in a folder of its own.

    Parameters
    ----------
    out, hide, parameter_file, command
        See `make_lift`.
    count : int
        Configurations; the paper has 14.
    rig : LiftRig, optional
        Settings of all; default: ten trips from end to end at 1 kHz.

    Returns
    -------
    list of Path
        The study files.
    """
    rig = rig or LiftRig(only_express=True, logger=Logger(rate=1000.0, fine=4), loads=(0.0,))
    folder, found, rows = check_folder(out), [], []
    for k in range(1, count + 1):
        one = dataclasses.replace(rig, configuration=k)
        one = dataclasses.replace(one, rails=drawn_spectrum(one))
        name = f"configuration_{k:02d}"

        def told(text: str, number: int = k) -> None:
            progress(f"configuration {number} of {count}: {text}")

        found.append(
            make_lift(folder / name, hide, rig=one, parameter_file=parameter_file, command=command, progress=told)
        )
        right = 1e3 * np.abs(one.profiles["cabin.right_x"].deviation)
        rows.append(
            {"folder": name, "median_mm": round(float(np.median(right)), 4), "largest_mm": round(float(right.max()), 4)}
        )
    text = bench_texts.configurations_readme([str(r["folder"]) for r in rows], command or "vtsdt bench lift")
    (folder / "README.md").write_text(text, encoding="utf-8")
    write_json(
        folder / "truth.json",
        {"synthetic": True, "machine": "lift", "seed": int(rig.seed), "cabin.right_x": rows},
    )
    return found


# -------------------------------------------------------------------- command line


def _parser() -> Any:
    from vtsdt.cli.arguments import Parser, common, number, whole

    parser = Parser(
        prog="vtsdt bench lift",
        description=(
            "Write recordings of a virtual lift, as a rig would, with a study file beside them. "
            "Without --hide nothing is hidden."
        ),
    )
    add = parser.add_argument
    add(
        "--hide",
        metavar="KIND[@WHERE]",
        action="extend",
        nargs="+",
        default=[],
        help="effect to hide; several possible",
    )
    add("--list", action="store_true", help="print what can be hidden, where, and its usual size")
    add("--seed", metavar="N", type=whole(0, "seed"), default=0, help="of all random numbers (default 0)")
    add(
        "--model",
        metavar="NAME",
        default="one_dimensional",
        help=f"under test: {', '.join(MODELS)} (default the first)",
    )
    add("--trips", metavar="N", type=whole(2, "number of trips"), default=10, help="recordings (default 10)")
    add(
        "--rate",
        metavar="HZ",
        type=number(True, "rate"),
        default=None,
        help="rows a second (default 250; 1000 with --configurations)",
    )
    add(
        "--loads",
        metavar="KG",
        type=number(False, "mass"),
        nargs="+",
        default=[],
        help="payloads in turn (default 0 2 4 for the 1D model)",
    )
    add(
        "--guides",
        metavar="HOW",
        default="drawn",
        choices=("drawn", "given"),
        help="drawn from a spectrum, or given by the lift's parameters (default drawn)",
    )
    add("--lift", metavar="FILE.toml", default=None, help="parameters of the lift (default: the shipped bench)")
    add(
        "--strength",
        metavar="FACTOR",
        type=number(True, "factor"),
        default=1.0,
        help="factor on the usual size of what is hidden (default 1)",
    )
    add(
        "--disturbance",
        metavar="N",
        type=number(False, "force"),
        default=1.0,
        help="root mean square of the force that disturbs the cabin, N (default 1)",
    )
    add(
        "--unknown-over",
        metavar="WHAT",
        default="position",
        help="what unknown_force depends on: position, speed or time",
    )
    add("--express", action="store_true", help="all trips from end to end, up and down in turn")
    add(
        "--configurations",
        metavar="N",
        type=whole(1, "number of configurations"),
        default=0,
        help="write N folders, each with the guides set anew; implies --express",
    )
    common(parser, out=False)
    return parser


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt bench lift``."""
    from multibody.base.progress import ProgressLine
    from vtsdt.cli.arguments import CommandError

    args = _parser().parse_args(list(arguments))
    if not args.list and args.out is None:
        raise CommandError("--out DIR is missing: name a folder for the recordings, or ask for --list")
    parameters = LiftParameters.load(args.lift) if args.lift else LiftParameters.bench()
    many = bool(args.configurations)
    rate = args.rate or (1000.0 if many else 250.0)
    rig = LiftRig(
        seed=args.seed,
        trips=args.trips,
        strength=args.strength,
        disturbance=Disturbance(args.disturbance),
        logger=Logger(rate=rate, fine=max(1, round(4000.0 / rate))),
        over=args.unknown_over,
        under_test=args.model,
        parameters=parameters,
        rails=RailSpectrum() if args.guides == "drawn" else None,
        loads=tuple(args.loads) or ((0.0,) if many else ()),
        only_express=args.express or many,
    )
    command = " ".join(("vtsdt bench lift", *_told(arguments)))
    with ProgressLine(args.quiet) as progress:
        progress("prepare the models of the lift")
        if args.list:
            rows = rig.list()
        elif many:
            studies = make_configurations(
                args.out,
                args.configurations,
                args.hide,
                rig=rig,
                parameter_file=args.lift,
                command=command,
                progress=progress,
            )
        else:
            studies = [
                make_lift(args.out, args.hide, rig=rig, parameter_file=args.lift, command=command, progress=progress)
            ]
    if args.list:
        from discrepancy.rigs.texts import list_table

        print(list_table(rows))
    elif not args.quiet:
        if many:
            print(f"{len(studies)} configurations of {args.trips} synthetic trips each are in {args.out}")
        else:
            print(f"{args.trips} synthetic recordings of a virtual lift are in {studies[0].parent}")
            print(f"next: vtsdt diagnose {studies[0]} --out {studies[0].parent / 'diagnosis'}")
    return 0


def _told(arguments: Sequence[str]) -> list[str]:
    """Return the words of the command that a README may tell: not what was hidden, nor how large, nor where it is."""
    kept, skip, words = [], 0, list(arguments)
    while skip < len(words):
        word = words[skip]
        name = word.partition("=")[0]
        if name in ("--hide", "--out", "--strength", "--unknown-over", "--quiet"):
            skip += 1
            if "=" not in word:
                while skip < len(words) and not words[skip].startswith("--"):
                    skip += 1
            continue
        kept.append(word)
        skip += 1
    return kept
