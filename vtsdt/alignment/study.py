"""How good the alignment sensor is, and how it degrades: ``python -m vtsdt.alignment.study --out DIR``.

On virtual lifts, whose truth is known: ten trips with effects that the cabin model lacks (both rails bent in both
directions, a disturbing force, gear losses, other parameters, noise and offsets of sensors).  The scores of each lift
are kept in DIR as soon as they are known; a run that was interrupted continues from there.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from multibody.base.progress import Progress, ProgressLine, silent
from vtsdt.alignment.estimate import align
from vtsdt.alignment.filter import DEFAULT
from vtsdt.alignment.score import HEIGHTS, Score, score
from vtsdt.alignment.study_lines import EVERY_LIFT, IF_SHORT, TEN_TRIPS, LiftScores, Line, lines
from vtsdt.alignment.study_page import page
from vtsdt.alignment.trips import AlignmentError
from vtsdt.alignment.virtual_lifts import EVALUATED_TRIPS, LiftCase, make_case, prefixed, prepared, with_sensor_errors

__all__ = ["evaluate", "run_study"]


def evaluate(
    case: LiftCase, chosen: Sequence[Line], known: LiftScores | None = None, progress: Progress = silent
) -> Iterator[LiftScores]:
    """Yield the scores of a lift, again after every line.

    Parameters
    ----------
    case : LiftCase
    chosen : sequence of Line
    known : LiftScores, optional
        Scores of an earlier run; their lines are not run again.
    progress : callable
    """
    truth, inside = case.evaluated.truth, _evaluated(case.height)
    scores: dict[str, Score | str] = dict(known.scores) if known else {}
    for k, line in enumerate(chosen):
        if line.name not in scores:
            progress(f"line {k + 1} of {len(chosen)}: {line.name}")
            scores[line.name] = _line_score(case, line)
            yield LiftScores(
                seed=case.seed,
                friction=truth["cabin_guide.mu"] * truth["cabin_guide.stiffness"],
                mass=truth["cabin.mass"],
                factor=_friction_factor(case),
                spread=float(case.pressing[inside].std()),
                scores=dict(scores),
            )


def _friction_factor(case: LiftCase) -> float:
    """Return the factor that the scaling estimates; NaN if its trips are refused."""
    try:
        return case.scaled()[1]
    except AlignmentError:
        return float("nan")


def _line_score(case: LiftCase, line: Line) -> Score | str:
    """Return the score of a lift's estimate from the recordings of a line, or why they are refused."""
    trips = prepared(with_sensor_errors(line.take(case), case.seed, **line.errors))
    try:
        parameters, _ = case.scaled(line.arguments.get("tuning", DEFAULT))
        alignment = align(trips, parameters, observe=False, **line.arguments)
    except AlignmentError as refused:
        return refused.faults[0]
    return score(alignment, case.height, case.pressing, case.in_plane)


def _evaluated(height: np.ndarray) -> np.ndarray:
    return (height >= HEIGHTS[0] - 1e-9) & (height <= HEIGHTS[1] + 1e-9)


def run_study(
    seeds: Sequence[int],
    folder: Path,
    progress: Progress = silent,
    groups: Sequence[str] | None = None,
    full: int | None = None,
) -> list[LiftScores]:
    """Return the scores of virtual lifts, using those that the folder already has.

    Parameters
    ----------
    seeds : sequence of int
    folder : path
        Gets ``lift-SEED.json``; scores of another version of the code are not used.
    progress : callable
    groups : sequence of str, optional
        Groups of lines; default: all.
    full : int, optional
        How many lifts, from the first, take all these lines.  The others take those of `EVERY_LIFT`, and those of
        `IF_SHORT` if they fall short.  Default: all lifts.
    """
    wanted = [line for line in lines() if groups is None or line.group in groups]
    code, results = _code(), []
    for k, seed in enumerate(seeds):
        path = folder / f"lift-{seed}.json"
        chosen = [line for line in wanted if full is None or k < full or line.what in EVERY_LIFT]
        prefix = f"lift {k + 1} of {len(seeds)}: "
        stored = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        known = LiftScores.of(stored["lift"]) if stored.get("code") == code else None
        case: LiftCase | None = None
        for part in (chosen, [line for line in lines() if line.what in IF_SHORT]):
            if known is not None and all(line.name in known.scores for line in part):
                continue
            if part is not chosen and known is not None and not _falls_short(known):
                continue
            case = case or make_case(seed, progress=prefixed(progress, prefix))
            for scores in evaluate(case, part, known, prefixed(progress, prefix)):
                known = scores
                text = json.dumps({"code": code, "lift": dataclasses.asdict(known)}, indent=1)
                path.with_suffix(".part").write_text(text + "\n", encoding="utf-8")
                path.with_suffix(".part").replace(path)
        if k == 0 and case is not None:
            _draw(case, folder)
        assert known is not None
        results.append(known)
    return results


def _falls_short(lift: LiftScores) -> bool:
    """True if ten trips of a lift do not reach what is required; False where that was not run."""
    ten = [v for k, v in lift.scores.items() if k.endswith(f": {TEN_TRIPS}")]
    return bool(ten) and not (isinstance(ten[0], Score) and ten[0].passed)


def _code() -> str:
    """Return a hash of the code that estimates and evaluates."""
    import hashlib

    here = Path(__file__).parent
    names = ("estimate", "filter", "virtual_lifts", "rail", "result", "score", "sections", "trips")
    text = b"".join((here / f"{name}.py").read_bytes() for name in names)
    return hashlib.sha256(text).hexdigest()[:16]


def _draw(case: LiftCase, folder: Path) -> None:
    """Draw the first lift's estimate and the truth."""
    alignment = align(prepared(case.evaluated.records[:EVALUATED_TRIPS]), case.scaled()[0], observe=False)
    figure = alignment.plot(truth=np.interp(alignment.height, case.height, case.pressing))
    figure.savefig(folder / "alignment-study.png", dpi=120, metadata={"Software": None})


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study and write its page, JSON and a figure."""
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
        results = run_study(args.seeds, out, progress, args.groups, args.full)
    (out / "alignment.md").write_text(page(results, command), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
