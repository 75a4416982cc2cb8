"""``vtsdt bench gear``: recordings of the virtual gear rig."""

from __future__ import annotations

import argparse

from discrepancy.rigs.recording import BenchError
from gearbox.rig.accelerometers import make_gear
from gearbox.rig.dataset import DatasetPlan, write_dataset
from gearbox.rig.encoders import make_encoders
from gearbox.rig.hidden import KINDS
from gearbox.rig.rig import GearRig
from gearbox.stage.faults import FAULTS, HEALTHY
from multibody.base.progress import ProgressLine

__all__ = ["listing", "main"]


def listing(strength: float = 1.0) -> list[tuple[str, str, str, str]]:
    """Kind, place, usual size and meaning of everything that can be hidden."""
    rows = []
    for kind in KINDS.values():
        size = f"{strength * kind.usual * kind.size:.3g} {kind.unit}".rstrip()
        rows += [(kind.kind, where, size, kind.what) for where in kind.places]
    return rows


def main(arguments: list[str]) -> int:
    """Run ``vtsdt bench gear``; ``arguments`` are the words after it."""
    parser = argparse.ArgumentParser(
        prog="vtsdt bench gear",
        description="Write recordings of a virtual gear stage. They are synthetic. Without --hide nothing is hidden.",
    )
    parser.add_argument(
        "--hide",
        metavar="KIND[@WHERE]",
        action="extend",
        nargs="+",
        default=[],
        help="effect to hide; give several, or repeat the option",
    )
    parser.add_argument("--list", action="store_true", help="print what can be hidden, where, and its usual size")
    parser.add_argument("--out", metavar="DIR", help="folder to write into; made if it is not there")
    parser.add_argument("--seed", metavar="N", type=int, default=0, help="of all random numbers (default 0)")
    parser.add_argument(
        "--manufacturing",
        metavar="FACTOR",
        type=float,
        default=0.0,
        help="factor on the usual errors of manufacturing and assembly of a real stage (default 0: none)",
    )
    parser.add_argument(
        "--strength",
        metavar="FACTOR",
        type=float,
        default=1.0,
        help="factor on the usual size of what is hidden (default 1)",
    )
    parser.add_argument(
        "--noise", metavar="M_S2", type=float, default=0.3, help="noise of the accelerometers, m/s² (default 0.3)"
    )
    parser.add_argument(
        "--housing",
        choices=("flexible", "rigid", "clamped"),
        default="flexible",
        help="of the rig and of the model under test (default flexible)",
    )
    parser.add_argument(
        "--encoders",
        action="store_true",
        help="turn the stage slowly and record encoders and torque, for vtsdt diagnose",
    )
    labelled = parser.add_argument_group(
        "labelled recordings for a classifier", "every label at every severity, speed and load; see labels.csv"
    )
    labelled.add_argument(
        "--faults",
        metavar="LABEL[@WHERE]",
        nargs="+",
        help=f"write these instead: 'all', or some of {', '.join(FAULTS)}; '{HEALTHY}' is always among them",
    )
    plan = DatasetPlan(labels=(HEALTHY,))
    for option, metavar, values, what in (
        ("--severities", "S", plan.severities, "1 is a grave fault"),
        ("--speeds", "RPM", plan.speeds, "r/min of the input shaft"),
        ("--loads", "NM", plan.torques, "N·m at the output shaft"),
    ):
        labelled.add_argument(
            option,
            metavar=metavar,
            nargs="+",
            type=float,
            default=tuple(values),
            help=f"{what} (default {' '.join(f'{v:g}' for v in values)})",
        )
    labelled.add_argument(
        "--repeats", metavar="N", type=int, default=plan.repeats, help="recordings of each (default 1)"
    )
    labelled.add_argument(
        "--rig",
        metavar="SEED",
        type=int,
        help="seed of the rig that is recorded, with --manufacturing for its errors (default: the paper's stage)",
    )
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    given = parser.parse_args(arguments)
    if given.list:
        rows = [("KIND", "WHERE", "USUAL SIZE", "MEANING"), *listing(given.strength)]
        wide = [max(len(r[i]) for r in rows) for i in range(3)]
        for row in rows:
            print("  ".join(text.ljust(w) for text, w in zip(row[:3], wide, strict=True)) + "  " + row[3])
        return 0
    if given.out is None:
        raise BenchError(["--out DIR is missing: name a folder for the recordings, or ask for --list"])
    if given.faults is not None:
        return _labelled(given)
    rig = GearRig(
        seed=given.seed,
        manufacturing=given.manufacturing,
        strength=given.strength,
        noise=given.noise,
        housing=given.housing,
    )
    with ProgressLine(given.quiet) as progress:
        progress("preparing the stage of the rig")
        make = make_encoders if given.encoders else make_gear
        study = make(given.out, given.hide, rig=rig, progress=progress)
    if not given.quiet:
        command, result = ("diagnose", "diagnosis") if given.encoders else ("update-gearbox", "updating")
        print(f"Synthetic recordings of a virtual gear stage are in {study.parent}")
        print(f"next: vtsdt {command} {study} --out {study.parent / result}")
    return 0


def _labelled(given: argparse.Namespace) -> int:
    """Write a labelled data set."""
    if given.hide or given.encoders:
        raise BenchError(["--faults writes a labelled data set: leave out --hide and --encoders"])
    named = tuple(FAULTS) if given.faults == ["all"] else tuple(given.faults)
    plan = DatasetPlan(
        labels=(HEALTHY, *(label for label in dict.fromkeys(named) if label != HEALTHY)),
        severities=tuple(given.severities),
        speeds=tuple(given.speeds),
        torques=tuple(given.loads),
        repeats=given.repeats,
        noise=given.noise,
        seed=given.seed,
        rig=given.rig,
        manufacturing=given.manufacturing,
        housing=given.housing,
    )
    with ProgressLine(given.quiet) as progress:
        progress("preparing the stage")
        labels = write_dataset(given.out, plan, progress=progress)
    if not given.quiet:
        print(f"{len(labels)} synthetic recordings of {labels['label'].nunique()} labels are in {given.out}")
        print("labels.csv says what each of them is")
    return 0
