"""The commands ``vtsdt diagnose`` and ``vtsdt compare``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

__all__ = ["compare", "diagnose"]

WIDE = 6  # numbers beside each other that still fit a terminal


def diagnose(args: Any) -> int:
    """Run the whole loop on a study file and write what it found.

    Parameters
    ----------
    args : namespace
        ``study``, ``out``, ``seed``, ``max_effects``, ``resume``, ``quiet``, ``progress``.
    """
    from discrepancy.problem.study_file import StudyError
    from discrepancy.study.history import restore, save_history
    from discrepancy.study.study import Study

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
    import sys

    print(f"vtsdt: interrupted: {_so_far(conclusion)}; go on with the same command and --resume", file=sys.stderr)
    return 130


def _so_far(conclusion: Any) -> str:
    count = len(conclusion.accepted)
    return "no effect was found yet" if not count else f"{count} effect{'s' if count > 1 else ''} found so far"


def compare(args: Any) -> int:
    """Compare model and records, say where the model fails, and write that; nothing is added."""
    from discrepancy.conclusion.conclude import conclude
    from discrepancy.study.study import Study

    study = Study.from_file(args.study, seed=args.seed, progress=args.progress)
    _ = study.stage
    conclusion = conclude(study)
    _finish(study, conclusion, Path(args.out), args, compared_only=True)
    return 0


def _finish(study: Any, conclusion: Any, out: Path, args: Any, *, compared_only: bool = False) -> None:
    from dataclasses import replace

    from discrepancy.report.write import write_report

    if compared_only:
        conclusion = replace(conclusion, verdict="", sentence="")
    files = write_report(conclusion, out)
    if not args.quiet:
        _show(study, conclusion, files)


def _show(study: Any, conclusion: Any, files: list[Path]) -> None:
    """Print the error stage by stage, the answer, and where the report is."""
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console()
    table = Table(title="Root mean square error, stage by stage")
    parts = [p for p in ("identify", "validate") if study.stages[0].fits(p)]
    names = study.stages[0].outputs
    if len(names) * len(parts) <= WIDE:
        table.add_column("stage")
        for part in parts:
            for name in names:
                table.add_column(escape(f"{name}\n[{study.stages[0].system.unit(name)}]\n{part}"), justify="right")
        for stage in study.stages:
            table.add_row(stage.name, *(f"{stage.rmse(part)[name]:.4g}" for part in parts for name in names))
    else:  # many outputs: they go down the page and the stages across
        table.add_column("output")
        for stage in study.stages:
            table.add_column(stage.name, justify="right", overflow="fold")
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
