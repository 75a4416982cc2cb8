"""Error rates of the search: virtual machines with no effect, one or several hidden, diagnosed by the hundred.

`vtsdt validate discrepancy` runs the suites on a virtual machine, whose data come from another integrator, other
friction regularisation, sensor noise, quantisation, jitter and a coloured disturbance.  Every case is a line of a
JSON-lines file, so that an interrupted run continues where it stopped.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from discrepancy.validation.cases import MACHINES, diagnosed, hidden_trial, machine_module, null_trial
from discrepancy.validation.masking_cases import masking_trial
from discrepancy.validation.trials import SUITES, Trial, file_name, page, rates, read_trials, with_section
from multibody.base.process_pool import process_pool

#: Machine, suite, seed and what is hidden.
Task = tuple[str, str, int, tuple[str, ...]]

__all__ = ["main", "run_suite"]

TRIALS = 100
NOT_IN_KINDS = ("unknown_force",)  # has a suite of its own
COMPARISONS = ("peers", "resampled")  # have pages of their own


def _plan(suite: str, trials: int, first: int, machine: str, sample: int = 0) -> list[Task]:
    import numpy as np

    module, rng = machine_module(machine), np.random.default_rng(first)
    if suite == "null":
        return [(machine, "null", first + k, ()) for k in range(trials)]
    if suite == "masking":  # the records decide which effects mask each other
        return [(machine, "masking", first + k, ()) for k in range(trials)]
    if suite == "unknown":
        return [(machine, "unknown", first + k, (module.UNKNOWN,)) for k in range(trials)]
    names = [n for n in module.names() if n.partition("@")[0] not in NOT_IN_KINDS]
    if suite in ("pairs", "triples"):
        count = 2 if suite == "pairs" else 3
        drawn = [tuple(rng.choice(names, count, replace=False).tolist()) for _ in range(trials)]
        return [(machine, suite, first + k, each) for k, each in enumerate(drawn)]
    if not sample:
        return [(machine, "kinds", first + k, (name,)) for name in names for k in range(trials)]
    chosen = rng.permutation(names).tolist()[:sample]
    return [(machine, "kinds", first + k, (name,)) for k in range(trials) for name in chosen]


def _run(task: Task) -> Trial:
    machine, suite, seed, hidden = task
    try:
        if suite == "null":
            return null_trial(seed, machine)
        if suite == "masking":
            return masking_trial(seed, machine)
        if suite == "unknown":
            from discrepancy.effects.uncatalogued_laws import OVER

            return diagnosed("unknown", seed, hidden, machine, over=OVER[seed % len(OVER)])
        return hidden_trial(seed, hidden, suite, machine)
    except Exception as error:  # one case that fails must not lose the others
        return Trial(
            suite=suite,
            seed=seed,
            hidden=hidden,
            verdict="failed",
            found=(),
            note=f"{type(error).__name__}: {error}"[:300],
        )


def run_suite(
    suite: str,
    trials: int,
    out: Path,
    *,
    first: int = 1000,
    workers: int = 2,
    machine: str = "axis",
    module: str = "",
    sample: int = 0,
    progress: Callable[[str], None] = lambda text: None,
) -> list[Trial]:
    """Run a suite, or what an earlier run left of it, and return all its trials.

    Parameters
    ----------
    suite : {"null", "kinds", "pairs", "triples", "masking", "unknown"}
    trials : int
        Number of seeds (of each kind for ``"kinds"``).
    out : Path
        Folder of ``<suite>.jsonl`` (``<machine>-<suite>.jsonl`` of another machine than the axis).
    first : int
        First seed.
    workers : int
        Processes.
    machine : str
        For the files' names.
    module : str
        Where the machine is; see `discrepancy.validation.suite_axis`.
    sample : int
        For ``"kinds"``: this many kinds, drawn by the first seed, instead of all.
    """
    out.mkdir(parents=True, exist_ok=True)
    path = out / file_name(machine, suite)
    done = read_trials(path)
    known = {(t.seed, () if suite == "masking" else t.hidden) for t in done}
    left = [task for task in _plan(suite, trials, first, module or machine, sample) if (task[2], task[3]) not in known]
    with process_pool(workers) as pool, path.open("a") as stream:
        for count, trial in enumerate(pool.map(_run, left), 1):
            stream.write(json.dumps(asdict(trial)) + "\n")
            stream.flush()
            done.append(trial)
            progress(
                f"{suite} {count}/{len(left)}: seed {trial.seed} {' + '.join(trial.hidden) or 'nothing'} hidden, "
                f"{trial.verdict}: {', '.join(trial.found) or 'nothing'} ({trial.seconds:.0f} s)"
            )
    return done


def main(arguments: Sequence[str], machines: Mapping[str, str] | None = None) -> int:
    """Run the suites named on the command line and write ``results.md`` and ``results.json``.

    Parameters
    ----------
    arguments : sequence of str
    machines : mapping of str to str, optional
        Further machines: their names, and the modules where they are.
    """
    import argparse
    from datetime import date

    known = {**MACHINES, **(machines or {})}

    parser = argparse.ArgumentParser(
        prog="vtsdt validate discrepancy",
        description="How often the search for a missing effect is right, on a virtual machine.",
    )
    parser.add_argument(
        "suites", nargs="*", default=["null", "kinds"], metavar="SUITE", help=f"of {', '.join((*SUITES, *COMPARISONS))}"
    )
    parser.add_argument(
        "--out", required=True, type=Path, help="folder of the trials and the results; a run goes on there"
    )
    parser.add_argument("--machine", choices=sorted(known), default="axis", help="default: the axis")
    parser.add_argument("--sample", type=int, default=0, metavar="N", help="of 'kinds': N kinds drawn by the seed")
    parser.add_argument("--page", type=Path, help="put the machine's results into this page of the documentation")
    parser.add_argument("--trials", type=int, help="seeds (of each kind, for 'kinds'); default 100, of the gear 3")
    parser.add_argument("--seed", type=int, default=1000, help="first seed; default 1000")
    parser.add_argument("--workers", type=int, default=2, help="processes; default 2")
    parser.add_argument("--study", type=Path, help="of 'resampled': study of a real machine")
    parser.add_argument(
        "--peers", action="store_true", help="of 'resampled': ask other methods about the same residuals"
    )
    parser.add_argument("--quiet", action="store_true", help="no progress")
    args = parser.parse_args(list(arguments))
    if args.trials is None:
        args.trials = getattr(machine_module(known[args.machine]), "TRIALS", TRIALS)
    unknown = [s for s in args.suites if s not in (*SUITES, *COMPARISONS)]
    if unknown or args.trials < 1:
        parser.error(
            f"there is no suite '{unknown[0]}': take {', '.join((*SUITES, *COMPARISONS))}"
            if unknown
            else "--trials must be at least 1"
        )
    if "unknown" in args.suites and not machine_module(known[args.machine]).UNKNOWN:
        parser.error(f"the virtual {args.machine} hides no unknown force: leave the suite 'unknown' out")
    if "masking" in args.suites and not getattr(machine_module(known[args.machine]), "SCALED", True):
        parser.error(f"the virtual {args.machine} hides its effects at their usual size: leave the suite 'masking' out")
    if args.page is not None and not args.page.is_file():
        parser.error(f"--page {args.page}: there is no such file")
    if "resampled" in args.suites and args.study is None:
        parser.error("'resampled' needs --study STUDY.toml: whose residual is to be resampled")
    if args.peers and "resampled" not in args.suites:
        parser.error("--peers goes with 'resampled'; the comparison on a virtual machine is the suite 'peers'")
    if args.peers or "peers" in args.suites:
        from discrepancy.validation.peer_comparison import missing_peers

        if lacking := missing_peers():
            parser.error(f"{' and '.join(lacking)} not installed: the comparison needs pip install 'vtsdt[peers]'")
    for suite in args.suites:
        if suite in COMPARISONS:
            if suite == "peers":
                _peers(args, known[args.machine])
            else:
                _resampled(args)
            continue
        run_suite(
            suite,
            args.trials,
            args.out,
            first=args.seed,
            workers=args.workers,
            machine=args.machine,
            module=known[args.machine],
            sample=args.sample,
            progress=(lambda text: None) if args.quiet else _to_stderr,
        )
    if set(args.suites) <= set(COMPARISONS):
        return 0
    text = page(args.out, date.today().isoformat(), args.machine)
    (args.out / "results.md").write_text(text + "\n")
    rates_of_suites = {s: [list(r) for r in rates(read_trials(args.out / file_name(args.machine, s)))] for s in SUITES}
    (args.out / "results.json").write_text(json.dumps(rates_of_suites, indent=1) + "\n")
    if args.page is not None:
        args.page.write_text(with_section(args.page.read_text(), args.machine, text))
    from rich.console import Console
    from rich.markdown import Markdown

    Console().print(Markdown(text))
    return 0


def _peers(args: Any, module: str) -> None:
    """Run the comparison with other methods and write and show its page."""
    from datetime import date

    from rich.console import Console
    from rich.markdown import Markdown

    from discrepancy.validation.peer_comparison import peer_page, run_peers

    trials = run_peers(
        args.trials,
        args.out,
        first=args.seed,
        workers=args.workers,
        machine=args.machine,
        module=module,
        progress=(lambda text: None) if args.quiet else _to_stderr,
    )
    text = peer_page(trials, date.today().isoformat(), args.machine)
    (args.out / file_name(args.machine, "peers")).with_suffix(".md").write_text(text + "\n")
    Console().print(Markdown(text))


def _resampled(args: Any) -> None:
    """Resample the residual of a study's best model onto it and write and show how often that alarms."""
    from datetime import date

    from rich.console import Console
    from rich.markdown import Markdown

    from discrepancy.validation.resampled import ResamplingData, best_stage, repeats, resampled_alarms
    from discrepancy.validation.resampled_page import resampled_page

    progress = (lambda text: None) if args.quiet else _to_stderr
    stage, level = best_stage(args.study, args.out, progress)
    given = ResamplingData.of_stage(stage, progress)
    if given.caution:
        _to_stderr(given.caution)
    trials = resampled_alarms(given, args.trials, args.out, level=level, seed=args.seed, progress=progress)
    names = [str(e) for e in stage.effects]
    today = date.today().isoformat()
    text = resampled_page(trials, args.study.name, names, level, today, repeats(stage), given.caution)
    if args.peers:
        from discrepancy.validation.peer_methods import versions
        from discrepancy.validation.resampled_peers import resampled_peers, resampled_peers_page

        others = resampled_peers(given, args.trials, args.out, seed=args.seed, progress=progress)
        text += "\n\n" + resampled_peers_page(others, trials, versions(), today)
    (args.out / "resampled.md").write_text(text + "\n")
    Console().print(Markdown(text))


def _to_stderr(text: str) -> None:
    import sys

    sys.stderr.write(text + "\n")
    sys.stderr.flush()
