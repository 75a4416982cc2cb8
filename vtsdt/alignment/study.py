"""How good the alignment sensor is, and how it degrades: ``python -m vtsdt.alignment.study --out DIR``.

On the virtual lift, whose truth is known: ten trips with effects that the cabin model lacks (both rails bent in both
directions, a force that disturbs, gear losses, other parameters, noise and offsets of sensors).  Each lift's scores are
kept in DIR as soon as they are known: a run that was stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vtsdt.alignment.estimate import AlignmentError, align
from vtsdt.alignment.filter import DEFAULT, TUNINGS, Tuning
from vtsdt.alignment.score import HEIGHTS, Score, score
from vtsdt.alignment.virtual_lifts import Case, make_case, prepared, spoiled

__all__ = ["ALWAYS", "BASE", "CALM", "MORE", "WHY", "Judged", "Line", "judge", "lines", "run_study"]

#: Lines that the page quotes.
BASE, CALM, MORE = "ten trips, default tuning", "none, four trips", "20 trips"
#: Lines that every lift takes, and those that say why one falls short.
ALWAYS, WHY = (BASE, "6 trips", "4 trips", "2 trips"), (CALM, MORE)
_TRIPS = 10  # trips that count unless a line of the table says otherwise
_TABLE_2 = TUNINGS["table2"]
#: Seeds from here on were never looked at while the method was made.
FRESH = 101
#: Tunings that are laid beside the default, and what they are.
COMPARED: dict[str, tuple[Tuning, str]] = {
    "table2": (_TABLE_2, "Table 2 as printed, Q per second"),
    "table2_steps": (
        dataclasses.replace(_TABLE_2, name="table2_steps", process={k: 1e3 * v for k, v in _TABLE_2.process.items()}),
        "Table 2 as printed, Q per step of 1 ms",
    ),
    "bounded": (TUNINGS["bounded"], "Table 2, a hundredth of it for the lateral states"),
    "likelihood": (TUNINGS["likelihood"], "found by marginal likelihood from two trips of another lift"),
}

Take = Callable[[Case], Sequence[dict[str, np.ndarray]]]


@dataclass(frozen=True)
class Line:
    """A line of the table: what is done to the records, and to which of them.

    Parameters
    ----------
    group, what : str
    take : callable
        Returns the records of a lift.
    errors : dict
        Added to the records; see `vtsdt.alignment.virtual_lifts.spoiled`.
    arguments : dict
        Of `vtsdt.alignment.estimate.align`.
    """

    group: str
    what: str
    take: Take = field(repr=False)
    errors: dict[str, Any] = field(default_factory=dict)
    arguments: dict[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Group and words."""
        return f"{self.group}: {self.what}"


@dataclass(frozen=True)
class Judged:
    """What came out of one lift.

    Parameters
    ----------
    seed : int
    friction, mass : float
        True ones over nominal ones; friction is the product of coefficient and stiffness.
    factor : float
        On friction, found by the scaling.
    spread : float, m
        Standard deviation of the true deviation over the heights that count.
    found : dict of str to Score or str
        By the line's name; a text is the reason for which its trips are refused.
    """

    seed: int
    friction: float
    mass: float
    factor: float
    spread: float
    found: dict[str, Score | str]

    def score(self, what: str) -> Score | None:
        """Return the score of a line by its words; None if it was refused or is not there."""
        found = next((v for k, v in self.found.items() if k.endswith(f": {what}")), None)
        return found if isinstance(found, Score) else None

    @classmethod
    def of(cls, stored: dict[str, Any]) -> Judged:
        """Return what `dataclasses.asdict` wrote."""
        found = {k: v if isinstance(v, str) else Score.of(v) for k, v in stored["found"].items()}
        return cls(**{**stored, "found": found})


def lines() -> Iterator[Line]:
    """Yield the lines of the table."""
    ten = partial(_first, count=_TRIPS)
    yield Line("as recorded", BASE, ten)
    for tuning, what in COMPARED.values():
        yield Line("tuning", what, ten, {}, {"tuning": tuning})
    yield Line("smoother", "default tuning, smoothed backwards", ten, {}, {"smooth": True})
    for size in (0.001, -0.003, 0.003, 0.01):
        yield Line("gain of the tension", f"{100 * size:+g} %", ten, {"tension_gain": size})
    for size in (0.003, 0.01):
        yield Line(
            "gain of the tension", f"{100 * size:+g} %, not balanced", ten, {"tension_gain": size}, {"balanced": False}
        )
    both = {"tension_gain": 0.01, "tension_offset": 3.0}
    yield Line("gain and offset of the tension", "+1 %, 3 N", ten, both)
    for offset in (3.0, 10.0):
        yield Line("offset of the tension", f"{offset:g} N", ten, {"tension_offset": offset})
    for noise in (1.0, 3.0):
        yield Line("noise of the tension", f"{noise:g} N", ten, {"tension_noise": noise})
    yield Line("offset of the accelerometer", "0.3 m/s²", ten, {"acceleration_offset": 0.3})
    for noise in (0.03, 0.1):
        yield Line("noise of the accelerometer", f"{noise:g} m/s²", ten, {"acceleration_noise": noise})
    for noise in (1.0, 5.0):
        yield Line("height", f"noise of {noise:g} mm", ten, {"height_noise": 1e-3 * noise})
    yield Line("height", "offset of 20 mm", ten, {"height_offset": 0.02})
    yield Line("height", "gain of +1 %", ten, {"height_gain": 0.01})
    yield Line("disturbing force", CALM, lambda lift: lift.calm.records)
    yield Line("number of trips", MORE, lambda lift: (*lift.judged.records, *lift.more.records))
    for count in (6, 4, 2):
        yield Line("number of trips", f"{count} trips", partial(_first, count=count))
    yield Line("number of trips", "one trip up", partial(_first, count=1))
    yield Line("number of trips", "five trips, all up", lambda lift: lift.judged.records[:_TRIPS:2])


def _first(lift: Case, count: int) -> Sequence[dict[str, np.ndarray]]:
    return lift.judged.records[:count]


def judge(
    case: Case, chosen: Sequence[Line], known: Judged | None = None, progress: Callable[[str], Any] = lambda text: None
) -> Iterator[Judged]:
    """Yield what came out of a lift, after every line anew.

    Parameters
    ----------
    case : Case
    chosen : sequence of Line
    known : Judged, optional
        What came out before; its lines are not run again.
    progress : callable
    """
    truth, inside = case.judged.truth, _counting(case.height)
    found: dict[str, Score | str] = dict(known.found) if known else {}
    for k, line in enumerate(chosen):
        if line.name not in found:
            progress(f"line {k + 1} of {len(chosen)}: {line.name}")
            found[line.name] = _judged(case, line)
            yield Judged(
                case.seed, truth["cabin_guide.mu"] * truth["cabin_guide.stiffness"], truth["cabin.mass"],
                _factor(case), float(case.pressing[inside].std()), dict(found),
            )  # fmt: skip


def _factor(case: Case) -> float:
    """Return the factor that the scaling finds; NaN if its trips are refused."""
    try:
        return case.scaled()[1]
    except AlignmentError:
        return float("nan")


def _judged(case: Case, line: Line) -> Score | str:
    """Return how well a lift's alignment is told from its spoiled records, or why they are refused."""
    trips = prepared(spoiled(line.take(case), case.seed, **line.errors))
    try:
        parameters, _ = case.scaled(line.arguments.get("tuning", DEFAULT))
        found = align(trips, parameters, observe=False, **line.arguments)
    except AlignmentError as refused:
        return refused.faults[0]
    return score(found, case.height, case.pressing, case.in_plane)


def _counting(height: np.ndarray) -> np.ndarray:
    return (height >= HEIGHTS[0] - 1e-9) & (height <= HEIGHTS[1] + 1e-9)


def run_study(
    seeds: Sequence[int], folder: Path, progress: Callable[[str], Any] = lambda text: None,
    groups: Sequence[str] | None = None, full: int | None = None,
) -> list[Judged]:  # fmt: skip
    """Return what came out of virtual lifts, taking what the folder already has.

    Parameters
    ----------
    seeds : sequence of int
    folder : path
        Takes ``lift-SEED.json``; scores of other code than this are not taken.
    progress : callable
    groups : sequence of str, optional
        Groups of lines; default: all.
    full : int, optional
        How many lifts, the first ones, take all these lines.  The others take those of `ALWAYS`, and those of `WHY` if
        they fall short.  Default: every one.
    """
    wanted = [line for line in lines() if groups is None or line.group in groups]
    code, told = _code(), []
    for k, seed in enumerate(seeds):
        path = folder / f"lift-{seed}.json"
        chosen = [line for line in wanted if full is None or k < full or line.what in ALWAYS]
        before = f"lift {k + 1} of {len(seeds)}: "
        stored = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        known = Judged.of(stored["lift"]) if stored.get("code") == code else None
        case: Case | None = None
        for part in (chosen, [line for line in lines() if line.what in WHY]):
            if known is not None and all(line.name in known.found for line in part):
                continue
            if part is not chosen and known is not None and _reached(known):
                continue
            case = case or make_case(seed, progress=partial(_tell, progress, before))
            for now in judge(case, part, known, partial(_tell, progress, before)):
                known = now
                text = json.dumps({"code": code, "lift": dataclasses.asdict(known)}, indent=1)
                path.with_suffix(".part").write_text(text + "\n", encoding="utf-8")
                path.with_suffix(".part").replace(path)
        if k == 0 and case is not None:
            _draw(case, folder)
        assert known is not None
        told.append(known)
    return told


def _reached(lift: Judged) -> bool:
    """True if a lift reaches what is asked of ten trips, or was not asked."""
    base = [v for k, v in lift.found.items() if k.endswith(f": {BASE}")]
    return not base or (isinstance(base[0], Score) and base[0].good)


def _code() -> str:
    """Return a mark of the code that estimates and judges."""
    import hashlib

    here = Path(__file__).parent
    names = ("estimate", "filter", "virtual_lifts", "rail", "result", "score", "sections", "trips")
    text = b"".join((here / f"{name}.py").read_bytes() for name in names)
    return hashlib.sha256(text).hexdigest()[:16]


def _tell(progress: Callable[[str], Any], before: str, text: str) -> None:
    progress(before + text)


def _draw(case: Case, folder: Path) -> None:
    """Draw the first lift's estimate beside the truth."""
    found = align(prepared(case.judged.records[:_TRIPS]), case.scaled()[0], observe=False)
    figure = found.plot(truth=np.interp(found.height, case.height, case.pressing))
    figure.savefig(folder / "alignment-study.png", dpi=120, metadata={"Software": None})


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and write its page, JSON and a figure."""
    from multibody.base.progress import ProgressLine
    from vtsdt.alignment.study_page import page

    parser = argparse.ArgumentParser(prog="python -m vtsdt.alignment.study", description=__doc__)
    parser.add_argument("--out", metavar="DIR", required=True, help="folder for alignment.md and lift-SEED.json")
    parser.add_argument("--seeds", metavar="N", type=int, nargs="+", default=list(range(101, 111)), help="lifts")
    groups = list(dict.fromkeys(line.group for line in lines()))
    parser.add_argument("--groups", metavar="NAME", nargs="+", choices=groups, help=f"lines: {', '.join(groups)}")
    parser.add_argument("--full", metavar="N", type=int, help="how many lifts take all lines (default all)")
    parser.add_argument("--quiet", action="store_true")
    args = parser.parse_args(arguments)
    command = f"python -m vtsdt.alignment.study --out DIR --seeds {' '.join(map(str, args.seeds))}"
    if args.groups:
        command += " --groups " + " ".join(f'"{name}"' for name in args.groups)
    if args.full is not None:
        command += f" --full {args.full}"
    out = Path(args.out)
    out.mkdir(parents=True, exist_ok=True)
    with ProgressLine(args.quiet) as progress:
        told = run_study(args.seeds, out, progress, args.groups, args.full)
    (out / "alignment.md").write_text(page(told, command), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
