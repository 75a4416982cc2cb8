"""``vtsdt update-gearbox``: update a gear stage model from recordings, as section 3.4 of the gearbox paper.

The steps are in :mod:`gearbox.updating.chain`; here is the command and the way from a study file to them.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gearbox.updating.settings import OBJECTIVES
from multibody.base.progress import Progress, shown_in_notebooks, silent
from multibody.base.result_folder import check_owner

if TYPE_CHECKING:
    from gearbox.updating.result import UpdatingResult

__all__ = ["main", "update"]

#: File with the simulations, in the folder that is written to.
STORE = "simulations.jsonl"


@shown_in_notebooks
def update(
    study: str | Path,
    out: str | Path | None = None,
    *,
    processes: int | None = None,
    progress: Progress = silent,
    **changes: Any,
) -> UpdatingResult:
    """Update the model of a study file.

    Parameters
    ----------
    study : path
    out : path, optional
        Folder for the simulations (so that an interrupted run goes on where it stopped), ``updating.json``,
        ``report.html`` and the figures; nothing is written without it.
    processes : int, optional
        By default one for each processor, at most the number of processors this process may use.
    progress : callable
        Gets a line of text for each step and simulation.
    **changes
        Settings that replace the study's, such as ``seed`` and ``objective``.

    Raises
    ------
    StudyError, RecordError, SignalError
        For bad input, with all faults in one message.
    """
    from gearbox.updating.chain import UpdatingChain
    from gearbox.updating.report import OWNER
    from gearbox.updating.runs import Runs
    from gearbox.updating.study import load_vibration, read_updating_study

    given = read_updating_study(study)
    settings = given.settings(**changes)
    progress("building the model")
    load_vibration(str(given.file.path))  # so that its faults are raised here and not in a worker process
    progress("reading the recordings")
    identify, validate = given.recordings()
    folder = None if out is None else Path(out)
    subject = given.file.path.stem
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        check_owner(folder, OWNER, subject)
    store = None if folder is None else folder / STORE
    count = processes if processes is not None else len(os.sched_getaffinity(0))
    with Runs(given.source(), given.virtual(), store=store, processes=count, progress=progress) as runs:
        result = UpdatingChain(settings, runs, identify, validate, progress=progress).run()
    if folder is not None:
        progress("writing the report")
        result.write(folder, subject)
    return result


def main(arguments: list[str]) -> int:
    """Run the command; ``arguments`` are the words after ``vtsdt update-gearbox``."""
    import argparse

    parser = argparse.ArgumentParser(
        prog="vtsdt update-gearbox",
        description=(
            "Update a gear stage model from recordings: sensitivity, designs, response surfaces, fireflies; the result "
            "is simulated again and checked under conditions that were not used."
        ),
    )
    parser.add_argument("study", metavar="STUDY.toml", help="study file with a table [updating]")
    parser.add_argument("--out", metavar="DIR", required=True, help="folder to write into; made if it is not there")
    parser.add_argument("--seed", metavar="N", type=int, help="of all random numbers; default: the study's")
    parser.add_argument(
        "--objective",
        choices=tuple(OBJECTIVES),
        help="cosine similarity (Eq. 8) or difference (Eq. 7) at the first recording, or amplitudes and phases over "
        "all; default: the study's",
    )
    parser.add_argument("--processes", metavar="N", type=int, help="simulations at a time; default: one per processor")
    parser.add_argument(
        "--json", action="store_true", help="print the result as JSON, as in updating.json, and nothing else"
    )
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    parser.add_argument("--debug", action="store_true", help="show the traceback of an error")
    given = parser.parse_args(arguments)
    for name, least in (("seed", 0), ("processes", 1)):
        value = getattr(given, name)
        if value is not None and value < least:
            parser.error(f"--{name} {value}: give a whole number, {least} or more")
    _check_out(Path(given.out))
    # Simulations run in parallel: further threads of linear algebra in each would only compete.
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    from multibody.base.progress import ProgressLine

    with ProgressLine(given.quiet) as progress:
        result = update(
            given.study,
            given.out,
            processes=given.processes,
            progress=progress,
            seed=given.seed,
            objective=given.objective,
        )
    if given.json:
        print((Path(given.out) / "updating.json").read_text(encoding="utf-8").rstrip())
    elif not given.quiet:
        _show(result, Path(given.out))
    return 0


def _check_out(out: Path) -> None:
    """Refuse a folder that cannot be one before work begins."""
    if out.exists() and not out.is_dir():
        raise NotADirectoryError(20, "is a file: name a folder to write into", str(out))


def _show(result: UpdatingResult, out: Path) -> None:
    """Print the outcome, the parameters and the similarities."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    console = Console(highlight=False)
    # Eight columns must fit into a log of 80 characters.
    plain = {"box": SIMPLE_HEAD, "padding": (0, 1, 0, 0), "title_justify": "left"}
    table = Table(title="Parameters (Table 4)", **plain)  # type: ignore[arg-type]
    for name in ("parameter", "unit", "before", "updated", "range"):
        table.add_column(name, justify="left" if name in ("parameter", "unit") else "right")
    for parameter, row in result.parameters().iterrows():
        changed = f"{row['updated']:.5g}" if row["selected"] else "not selected"
        table.add_row(
            str(parameter), row["unit"], f"{row['start']:.5g}", changed, f"{row['lower']:.4g} … {row['upper']:.4g}"
        )
    console.print(table)
    table = Table(title="Cosine similarity, before and after", **plain)  # type: ignore[arg-type]
    for name in ("condition", "speed\n[r/min]", "load\n[N·m]", "used", "before", "after", "upper\nbound", "lag\n[ms]"):
        table.add_column(escape(name), justify="left" if name in ("condition", "used") else "right", no_wrap=True)
    for _, row in result.to_frame().iterrows():
        table.add_row(
            row["condition"],
            f"{row['speed [r/min]']:.2f}",
            f"{row['load [N·m]']:.4g}",
            "yes" if row["used for updating"] else "no",
            f"{row['before']:.4f}",
            f"{row['after']:.4f}",
            f"{row['upper bound']:.4f}",
            f"{row['lag [ms]']:+.4f}",
        )
    console.print(table)
    start = result.start.similarity
    if start is not None:
        console.print(f"before: {start.describe()}", soft_wrap=True)
    console.print(result.sentence(), soft_wrap=True)
    for directions in result.directions:
        console.print(directions.describe(), soft_wrap=True)
    console.print(f"report: {out / 'report.html'}", soft_wrap=True)
