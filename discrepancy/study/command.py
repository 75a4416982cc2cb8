"""The commands ``vtsdt diagnose`` and ``vtsdt compare``."""

from __future__ import annotations

import sys
from argparse import Namespace
from dataclasses import replace
from pathlib import Path

from discrepancy.conclusion.conclude import conclude
from discrepancy.conclusion.conclusion import Conclusion
from discrepancy.problem.study_file import StudyError
from discrepancy.report.write import write_report
from discrepancy.study.history import restore, save_history
from discrepancy.study.study import Study

__all__ = ["compare", "diagnose"]


def diagnose(args: Namespace) -> int:
    """Diagnose a study file and write the conclusion.

    Parameters
    ----------
    args : namespace
        ``study``, ``out``, ``seed``, ``max_effects``, ``resume``, ``quiet``, ``progress``.
    """
    study = Study.from_file(args.study, seed=args.seed, max_effects=args.max_effects, progress=args.progress)
    out = Path(args.out)
    history = out / "history.json"
    if getattr(args, "resume", False):
        if not history.exists():
            raise StudyError([f"--resume: there is no {history}: run the command without it first"])
        restore(study, history)
    study.checkpoint = lambda study: save_history(study, history)
    conclusion = study.diagnose()
    _finish(study, conclusion, out, args, compared_only=study.interrupted and not conclusion.accepted)
    if not study.interrupted:
        return 0
    count = len(conclusion.accepted)
    so_far = f"{count} effect{'s' if count > 1 else ''} found so far" if count else "no effect was found yet"
    print(f"vtsdt: interrupted: {so_far}; continue with the same command and --resume", file=sys.stderr)
    return 130


def compare(args: Namespace) -> int:
    """Compare model and records, locate the error, and write both; nothing is added."""
    study = Study.from_file(args.study, seed=args.seed, progress=args.progress)
    _ = study.stage  # made on first use
    conclusion = conclude(study)
    _finish(study, conclusion, Path(args.out), args, compared_only=True)
    return 0


def _finish(study: Study, conclusion: Conclusion, out: Path, args: Namespace, *, compared_only: bool = False) -> None:
    if compared_only:
        conclusion = replace(conclusion, verdict="", sentence="")
    files = write_report(conclusion, out)
    if not args.quiet:
        _show(study, conclusion, files)


def _show(study: Study, conclusion: Conclusion, files: list[Path]) -> None:
    """Print the error stage by stage, the conclusion, and the path of the report."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console()
    title = "Root mean square error, stage by stage"
    parts = [p for p in ("identify", "validate") if study.stages[0].fits(p)]
    names = study.stages[0].outputs
    table = Table("stage", title=title)
    for part in parts:
        for name in names:
            table.add_column(escape(f"{name}\n[{study.stages[0].system.unit(name)}]\n{part}"), justify="right")
    for stage in study.stages:
        table.add_row(stage.name, *(f"{stage.rmse(part)[name]:.4g}" for part in parts for name in names))
    if console.measure(table, options=console.options.update(max_width=10_000)).maximum > console.width:
        # one row for each output, the stages as columns; long names are folded, not cut
        table = Table(title=title)
        for header in ("output", *(stage.name for stage in study.stages)):
            table.add_column(header, justify="left" if header == "output" else "right", overflow="fold")
        for part in parts:
            for name in names:
                unit = study.stages[0].system.unit(name)
                cells = [f"{stage.rmse(part)[name]:.4g}" for stage in study.stages]
                table.add_row(escape(f"{name} [{unit}], {part}" if unit else f"{name}, {part}"), *cells)
    console.print(table)
    if conclusion.sentence:
        console.print(f"[bold]{conclusion.verdict}[/bold]: {conclusion.sentence}", soft_wrap=True)
    for text in conclusion.next_measurement if conclusion.sentence else ():
        console.print(f"[bold]next measurement[/bold]: {text}", soft_wrap=True)
    report = next((f for f in files if f.name == "report.html"), None)
    if report is not None:
        console.print(f"report: {report}", soft_wrap=True)
