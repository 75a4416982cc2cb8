"""Other methods on machines that no component made: cases that were judged, or studies of others with their truth.

A case is a folder with ``study.toml`` and ``truth.json``.  Every method gets the residual after recalibration and the
sensitivities to the same candidates; all answers are scored by the same rule.  A line of ``machine_peers.jsonl`` is one
case, so that an interrupted run continues.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from discrepancy.validation.machines.judge import UNKNOWN_VERDICTS, WORSE, score_names, set_of
from discrepancy.validation.machines.reliability import jeffreys
from discrepancy.validation.peer_comparison import OURS, missing_peers
from multibody.base.process_pool import process_pool

__all__ = ["CaseAnswers", "Truth", "main", "our_answer", "peers_page", "score"]

if TYPE_CHECKING:
    from discrepancy.validation.peer_case import PeerCase
    from discrepancy.validation.peer_methods import Answer

FILE = "machine_peers.jsonl"


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What a case hides.

    Parameters
    ----------
    category : str
        "none", "single", "double", "pair", "masking", "ambiguous" or "outside".
    accept : tuple of tuple of str
        For each hidden effect the names that are right, as patterns of ``kind@where``.
    """

    category: str
    accept: tuple[tuple[str, ...], ...]

    @classmethod
    def read(cls, path: Path) -> Truth:
        """Read a ``truth.json``; a kind without a place is right everywhere, and a tie is right by any of its names."""
        data = json.loads(path.read_text(encoding="utf-8"))
        names = [e["accept"] for e in data["effects"] if e.get("accept")]
        if data["category"] == "ambiguous" and data.get("tie_set"):
            names = [data["tie_set"]]
        if data["category"] == "outside":
            names = []
        return cls(
            category=data["category"],
            accept=tuple(tuple(n if "@" in n else f"{n}@*" for n in each) for each in names),
        )


@dataclass(frozen=True, kw_only=True)
class CaseAnswers:
    """A case and what every method said of it.

    Parameters
    ----------
    case, category : str
    answers : dict
        Method → named, right, first, all_found, invented, alarm, ratio, worse, seconds.
    note : str
        Why the case does not count, if so.
    """

    case: str
    category: str
    answers: dict[str, dict[str, Any]] = field(default_factory=dict)
    note: str = ""


def score(truth: Truth, sets: Sequence[Sequence[str]], *, alarm: bool, unknown: bool) -> dict[str, Any]:
    """Score the names that a method gives, as those of this program are scored, and list them.

    Parameters
    ----------
    truth : Truth
    sets : sequence of sequence of str
        For each effect named, the weightiest first, what it may be, its name first.
    alarm : bool
        Whether the method says that something is missing.
    unknown : bool
        Whether it says that something is missing which has no name.
    """
    names = score_names(truth.category, truth.accept, sets, silent=not alarm, unknown=unknown)
    return {"named": [each[0] for each in sets], **asdict(names), "alarm": alarm}


def our_answer(truth: Truth, answer: Mapping[str, Any]) -> dict[str, Any]:
    """Score a ``diagnosis.json``."""
    sets = [set_of(e, answer) for e in answer["effects"] if e["kind"] != "unknown_force"]
    verdict, stages = answer["verdict"], answer["stages"]
    before, after = (stages[min(k, len(stages) - 1)]["validate"] or {} for k in (1, len(stages)))
    shares = [after[n]["rmse"] / before[n]["rmse"] for n in after if before[n]["rmse"] > 0.0]
    names = score(truth, sets, alarm=verdict != "nothing missing", unknown=verdict in UNKNOWN_VERDICTS)
    return {**names, "ratio": _mean(shares), "worse": bool(sets) and max(shares, default=1.0) > WORSE}


def _answers_of(folder: Path, diagnosis: Path) -> CaseAnswers:
    """Run every method on a case, and score it beside the answer of this program that is there already."""
    from discrepancy.study.study import Study
    from discrepancy.validation.peer_case import peer_case
    from discrepancy.validation.peer_methods import GAUSSIAN_PROCESS, REGRESSION_METHODS, residual_process

    truth = Truth.read(folder / "truth.json")
    answers: dict[str, dict[str, Any]] = {}
    if diagnosis.exists():
        answers[OURS] = our_answer(truth, json.loads(diagnosis.read_text(encoding="utf-8")))
    given = peer_case(Study.from_file(folder / "study.toml").stage)
    methods: dict[str, Callable[[PeerCase], Answer]] = {**REGRESSION_METHODS, GAUSSIAN_PROCESS: residual_process}
    for name, method in methods.items():
        start = time.process_time()
        try:
            answer = method(given)
        except (ValueError, ArithmeticError, RuntimeError) as error:
            answers[name] = {"failed": str(error)[:200]}
            continue
        sets = [[n, *(answer.ties if k == 0 else ())] for k, n in enumerate(answer.named)]
        names = score(truth, sets, alarm=answer.alarm, unknown=answer.alarm and not answer.named)
        seconds = time.process_time() - start
        answers[name] = {**names, "ratio": answer.ratio, "worse": answer.ratio > WORSE, "seconds": seconds}
    return CaseAnswers(case=folder.name, category=truth.category, answers=answers)


def _run_cases(
    cases: Sequence[tuple[Path, Path]], out: Path, *, workers: int, progress: Callable[[str], None]
) -> list[CaseAnswers]:
    """Run the comparison, or what an earlier run left of it, and return all its cases."""
    from concurrent.futures import as_completed

    if lacking := missing_peers():
        raise ModuleNotFoundError(
            f"{' and '.join(lacking)} not installed: the comparison needs the extra, pip install 'vtsdt[peers]'"
        )
    out.mkdir(parents=True, exist_ok=True)
    path = out / FILE
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    done = [CaseAnswers(**json.loads(line)) for line in lines if line.strip()]
    known = {c.case for c in done}
    left = [each for each in cases if each[0].name not in known]
    with process_pool(workers, tasks=1) as pool, path.open("a", encoding="utf-8") as stream:
        for count, ready in enumerate(as_completed([pool.submit(_run, *each) for each in left]), 1):
            case = ready.result()
            stream.write(json.dumps(asdict(case)) + "\n")
            stream.flush()
            done.append(case)
            progress(f"{count}/{len(left)} {case.case}: {case.note or f'{len(case.answers)} methods'}")
    return sorted(done, key=lambda c: c.case)


def _run(folder: Path, diagnosis: Path) -> CaseAnswers:
    try:
        return _answers_of(folder, diagnosis)
    except Exception as error:  # one case that fails must not lose the others
        truth = Truth.read(folder / "truth.json")
        note = f"failed: {type(error).__name__}: {error}"[:300]
        return CaseAnswers(case=folder.name, category=truth.category, note=note)


def peers_page(cases: Sequence[CaseAnswers], *, title: str, source: str) -> str:
    """Return the comparison as a page (Markdown).

    Parameters
    ----------
    cases : sequence of CaseAnswers
    title : str
    source : str
        What was run, and when.
    """
    counted = [c for c in cases if not c.note]
    methods = list(dict.fromkeys([OURS, *(m for c in counted for m in c.answers)]))
    lines = [
        f"# {title}",
        "",
        "The other methods get the residual after recalibration and the sensitivities of the outputs to every "
        "candidate, at the shape that fits best: none of them computes these, so that only the decision is compared. "
        "What names effects of the catalogue only cannot be right where the hidden one is outside it. Held-out error: "
        "median over the cases, as a share of that of the recalibrated model; worse: by more than 2 % (this program: "
        "in any output; the others: in the geometric mean).",
        "",
        source,
        "",
        "| method | right | nothing missing, and so said | truth first | all hidden among those named | cases with "
        "invented effects | outside the catalogue, told so | held-out error | worse held out |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for method in methods:
        given = [(c.category, c.answers[method]) for c in counted if "right" in c.answers.get(method, {})]
        hiding = [(k, a) for k, a in given if k not in ("none", "outside")]
        ratios = [a["ratio"] for k, a in hiding if a["ratio"] is not None and math.isfinite(a["ratio"])]
        cells = [
            _share([a["right"] for _, a in given]),
            _share([a["right"] for k, a in given if k == "none"]),
            _share([a["first"] for _, a in hiding]),
            _share([a["all_found"] for _, a in hiding]),
            _share([a["invented"] > 0 for _, a in given]),
            _share([a["right"] for k, a in given if k == "outside"]),
            f"{median(ratios):.2f}" if ratios else "–",
            _share([a["worse"] for _, a in given]),
        ]
        lines.append(f"| {method} | {' | '.join(cells)} |")
    lines += ["", "In brackets the 95 % interval of the rate (Jeffreys)."]
    if left_out := [c for c in cases if c.note]:
        lines += ["", "Cases that do not count:", "", *(f"- {c.case}: {c.note}" for c in left_out)]
    lines += [
        "",
        "## Cases",
        "",
        "| case | hidden | " + " | ".join(methods) + " |",
        "|---|---|" + "---|" * len(methods),
    ]
    for c in counted:
        cells = [_in_short(c.answers.get(m, {})) for m in methods]
        lines.append(f"| {c.case} | {c.category} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str]) -> int:
    """Command line of ``vtsdt validate discrepancy machine-peers``."""
    import argparse
    import sys
    from datetime import date

    from discrepancy.validation.peer_methods import versions

    parser = argparse.ArgumentParser(
        prog="vtsdt validate discrepancy machine-peers",
        description="Other methods on cases of 'vtsdt validate discrepancy machines', or on studies with a truth.json.",
    )
    add = parser.add_argument
    add("cases", type=Path, nargs="+", help="folders of cases, each a folder with study.toml and truth.json")
    add(
        "--answers", type=Path, help="folder with NAME/diagnosis.json for each case; default: out/ in the case's folder"
    )
    add("--title", default="Other methods on machines of plain equations", help="of the page; %(default)s")
    add("--workers", type=int, default=2, help="%(default)s")
    add("--out", required=True, type=Path, help="folder of results; a run goes on there")
    add("--page", type=Path, help="write the page (Markdown)")
    add("--quiet", action="store_true", help="no progress")
    args = parser.parse_args(list(arguments))
    folders = sorted(p.parent for root in args.cases for p in root.glob("*/truth.json"))
    folders = [f for f in folders if (f / "study.toml").exists()]
    if not folders:
        parser.error(f"no folder with study.toml and truth.json in {', '.join(map(str, args.cases))}")
    if args.workers < 1:
        parser.error("--workers must be at least 1")
    plan = [(f, (args.answers / f.name if args.answers else f / "out") / "diagnosis.json") for f in folders]
    if lacking := [str(d) for _, d in plan if not d.exists()]:
        print(f"no answer of this program for {len(lacking)} of {len(plan)} cases: {lacking[0]} …", file=sys.stderr)
    progress = (lambda text: None) if args.quiet else (lambda text: print(text, file=sys.stderr, flush=True))
    cases = _run_cases(plan, args.out, workers=args.workers, progress=progress)
    programs = ", ".join(f"{n} {v}" for n, v in versions().items())
    text = peers_page(cases, title=args.title, source=f"{date.today().isoformat()}, {len(cases)} cases; {programs}.")
    if args.page:
        args.page.write_text(text, encoding="utf-8")
    print(text.partition("## Cases")[0])
    return 0


def _mean(shares: Sequence[float]) -> float:
    """Return the geometric mean."""
    return math.exp(sum(map(math.log, shares)) / len(shares)) if shares else math.nan


def _share(hits: Sequence[bool]) -> str:
    if not hits:
        return "–"
    low, high = jeffreys(sum(hits), len(hits))
    return f"{sum(hits)}/{len(hits)} ({100 * low:.0f} to {100 * high:.0f} %)"


def _in_short(answer: Mapping[str, Any]) -> str:
    """Return what a method said of a case: right or not, and the names it gave."""
    if "right" not in answer:
        return "–" if "failed" not in answer else "failed"
    named = answer["named"]
    what = ", ".join(named[:2]) + (f" and {len(named) - 2} more" if len(named) > 2 else "")
    what = what or ("something" if answer["alarm"] else "nothing")
    return f"{'right' if answer['right'] else 'wrong'}: {what}"
