"""The commands ``vtsdt diagnose``, ``vtsdt compare``, ``vtsdt check`` and ``vtsdt catalogue``."""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from discrepancy.conclusion.conclude import conclude
from discrepancy.conclusion.conclusion import Conclusion
from discrepancy.drawing.check_figure import check_figure
from discrepancy.effects.catalogue import catalogue
from discrepancy.problem.candidate_patterns import check_patterns
from discrepancy.problem.problem import Problem, read_model, read_problem
from discrepancy.problem.study_file import StudyError
from discrepancy.questions.plausibility import check_problem
from discrepancy.report.write import write_report
from discrepancy.stages.stage import Stage
from discrepancy.study.history import fingerprint, restore, save_history
from discrepancy.study.study import Study
from multibody.base.quantity_text import count_text
from multibody.base.result_folder import check_owner
from multibody.base.stopping import Stopped
from multibody.base.terminal_text import printable

if TYPE_CHECKING:
    from rich.table import Table


__all__ = ["check", "compare", "diagnose", "list_catalogue"]

CHECKED = ("faults", "warnings", "facts")  # what `check` says, as it stands in check.json


def diagnose(args: Namespace) -> int:
    """Diagnose a study file and write the conclusion.

    Parameters
    ----------
    args : namespace
        ``study``, ``out``, ``seed``, ``max_effects``, ``resume``, ``quiet``, ``progress``.
    """
    study = Study(_checked(read_problem(args.study, seed=args.seed, max_effects=args.max_effects), args), args.progress)
    out = Path(args.out)
    check_owner(out, "diagnosis", study.problem.name)
    history = out / "history.json"
    if getattr(args, "resume", False):
        if not history.exists():
            raise StudyError([f"--resume: there is no {history}: run the command without it first"])
        restore(study, history)
        study.restart_search()
    study.checkpoint = lambda study: save_history(study, history)
    conclusion = study.diagnose()
    compared_only = study.interrupted and not conclusion.accepted
    _finish(study, conclusion, out, args, "diagnosis", compared_only=compared_only)
    if not study.interrupted:
        return 0
    count = len(conclusion.accepted)
    so_far = f"{count_text(count, 'effect')} found so far" if count else "no effect was found yet"
    reason = study.interruption
    print(f"vtsdt: {reason}: {so_far}; continue with the same command and --resume", file=sys.stderr)
    if study.untested:
        print(printable(study.untested), file=sys.stderr)
    return Stopped(reason).code


def compare(args: Namespace) -> int:
    """Compare model and records, locate the error, and write both; nothing is added."""
    study = Study(_checked(read_problem(args.study, seed=args.seed), args), args.progress)
    check_owner(Path(args.out), "comparison", study.problem.name)
    _ = study.stage  # made on first use
    conclusion = conclude(study)
    _finish(study, conclusion, Path(args.out), args, "comparison", compared_only=True)
    return 0


def _checked(problem: Problem, args: Namespace) -> Problem:
    """Return the problem with what `check` says of it among its warnings, and print that: it costs a simulation."""
    args.progress("whether model and records fit each other")
    checks = check_problem(problem, excitation=False)
    noted = [text for text in (*checks.faults, *checks.warnings) if text not in problem.warnings]
    if not args.quiet:
        for text in noted:
            print(f"vtsdt: {printable(text)}", file=sys.stderr)
    return replace(problem, warnings=(*problem.warnings, *noted))


def check(args: Namespace) -> int:
    """Print whether a study's model and records fit each other, and draw one record beside its simulation.

    Parameters
    ----------
    args : namespace
        ``study``, ``out`` (a folder or None), ``json``, ``quiet``, ``progress``.

    Returns
    -------
    int
        0, or 2 where the comparison would be meaningless.
    """
    args.progress("read the study and its records")
    problem = read_problem(args.study)
    args.progress("simulate every record once")
    checks = check_problem(problem)
    as_json = getattr(args, "json", False)
    for lead, texts in (("FAULT", checks.faults), ("warning", checks.warnings), ("ok", checks.facts)):
        if not as_json and (not args.quiet or lead == "FAULT"):
            for text in texts:
                print(f"{lead}: {printable(text)}")
    result = {"schema": 1, "study": problem.name, **{k: list(getattr(checks, k)) for k in CHECKED}}
    text = json.dumps(result, indent=2, ensure_ascii=False)
    if args.out is not None:
        Path(args.out).mkdir(parents=True, exist_ok=True)
        (Path(args.out) / "check.json").write_text(text + "\n", encoding="utf-8")
    if as_json:
        print(text)
    if args.out is not None and checks.model is not None:
        e = checks.experiment
        out = Path(args.out)
        units = [e.record.signals[n].unit for n in e.outputs]
        check_figure(e.name, e.time, e.measured, checks.model, e.outputs, units).savefig(out / "check.png", dpi=110)
        if not args.quiet and not as_json:
            print(f"picture: {out / 'check.png'}")
    return 2 if checks.faults else 0


def list_catalogue(args: Namespace) -> int:
    """Print every effect that fits a study's model, and whether the study looks for it.

    Parameters
    ----------
    args : namespace
        ``study``, ``names``, ``json``.
    """
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    study, model = read_model(args.study)
    system = model.build(probes=True)
    signals = tuple(study.outputs), tuple(study.inputs)
    patterns = check_patterns(system, *signals, study.candidates.include, study.candidates.exclude)
    if patterns.faults:
        raise StudyError([f"{study.path.name}, {text}" for text in patterns.faults])
    everything = catalogue(system, *signals)
    chosen = catalogue(system, *signals, include=study.candidates.include, exclude=study.candidates.exclude)
    if args.names:
        print("\n".join(printable(entry.name) for entry in chosen))
        return 0
    names = {entry.name for entry in chosen}
    if getattr(args, "json", False):
        effects = [
            {"name": e.name, "kind": e.kind.name, "where": e.where, "candidate": e.name in names} for e in everything
        ]
        result = {"schema": 1, "study": study.path.name, "effects": effects, "warnings": list(patterns.warnings)}
        print(json.dumps(result, indent=2, ensure_ascii=False))
        return 0
    table = Table(title=f"{len(chosen)} of {len(everything)} effects are candidates of {study.path.name}")
    table.add_column("kind", no_wrap=True)
    table.add_column("where", overflow="fold")
    if len(chosen) < len(everything):
        table.add_column("left out at", overflow="fold")
    for kind in dict.fromkeys(entry.kind.name for entry in everything):
        entries = [entry for entry in everything if entry.kind.name == kind]
        places = [[e.where for e in entries if (e.name in names) is wanted] for wanted in (True, False)]
        table.add_row(kind, *(escape(printable(", ".join(each))) for each in places[: len(table.columns) - 1]))
    Console().print(table)
    for text in patterns.warnings:
        print(f"vtsdt: {printable(text)}", file=sys.stderr)
    return 0


def _finish(
    study: Study, conclusion: Conclusion, out: Path, args: Namespace, kind: str, *, compared_only: bool = False
) -> None:
    if compared_only:
        conclusion = replace(conclusion, verdict="", sentence="")
    files = write_report(conclusion, out, kind=kind, run=fingerprint(study))
    if getattr(args, "json", False):
        sys.stdout.write(files[0].read_text(encoding="utf-8").rstrip() + "\n")
    elif not args.quiet:
        _show(study, conclusion, files)


def _show(study: Study, conclusion: Conclusion, files: list[Path]) -> None:
    """Print the error stage by stage, the conclusion, and the path of the report."""
    from rich.console import Console
    from rich.markup import escape

    console = Console(highlight=False)
    console.print(_error_table(study.stages))
    if conclusion.sentence:
        console.print(f"[bold]{conclusion.verdict}[/bold]: {escape(printable(conclusion.sentence))}", soft_wrap=True)
    for text in conclusion.next_measurement if conclusion.sentence else ():
        console.print(f"[bold]next measurement[/bold]: {escape(printable(text))}", soft_wrap=True)
    report = next((f for f in files if f.name == "report.html"), None)
    if report is not None:
        console.print(f"report: {report}", soft_wrap=True)


#: Words for the parts of the records where a column is narrow.
_COLUMNS = {"identify": "fitted", "validate": "held out"}


def _error_table(stages: Sequence[Stage]) -> Table:
    """Return the errors of every output from stage to stage: one line each, so that 80 columns are enough.

    Names that are longer than the column go on in a second line; numbers have columns of their own width.
    """
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    parts = [part for part in _COLUMNS if stages[0].fits(part)]
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), title="Root mean square error", title_justify="left")
    table.add_column("output and stage", overflow="fold")
    for part in parts:
        table.add_column(_COLUMNS[part], justify="right", no_wrap=True)
    for name in stages[0].outputs:
        unit = stages[0].system.unit(name)
        table.add_row(Text(printable(f"{name} [{unit}]" if unit else name), style="bold"))
        for stage in stages:
            table.add_row(Text(f"  {stage.name}"), *(f"{stage.rmse(part)[name]:.4g}" for part in parts))
    return table
