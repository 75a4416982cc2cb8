"""Other methods to find what is missing, on the same data: `vtsdt validate discrepancy peers`.

For each seed a virtual machine is run twice: with nothing hidden, and with one effect drawn from everything that can be
hidden, at its usual size.  Each method names what it takes to be missing.  A line of ``peers.jsonl`` is one case with
all answers, so that an interrupted run continues.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from discrepancy.validation.trials import file_name
from multibody.base.process_pool import process_pool

__all__ = ["OURS", "PeerTrial", "missing_peers", "peer_page", "run_peers"]

OURS = "this program"
TRUE = "the true effect, fitted"
AXIS = "discrepancy.validation.suite_axis"
NEEDED = ("pysindy", "sklearn")


@dataclass(frozen=True, kw_only=True)
class PeerTrial:
    """One case and what every method named.

    Parameters
    ----------
    seed : int
    hidden : tuple of str
        ``kind@where``; empty where nothing was hidden.
    answers : dict
        Method → named, ties, ratio (held-out error as a share of the recalibrated model's), alarm, seconds.
    columns_seconds : float
        Time to compute the sensitivities that the other methods were given.
    note : str
        Why the case does not count, if so.
    """

    seed: int
    hidden: tuple[str, ...]
    answers: dict[str, dict[str, Any]] = field(default_factory=dict)
    columns_seconds: float = math.nan
    note: str = ""


INTRODUCTION = (
    "None of these methods computes how a candidate changes the outputs of a closed loop, or removes from the residual "
    "what recalibration explains. Both were computed for them (except for PySINDy on states, on the axis, which builds "
    "its own regression from measured speed, torque and position), so that only the decision is compared: what to "
    "name, and when to name nothing. Each candidate came at the shape that fits best. Strengths with a sign that "
    "physics forbids were removed before counting. Settings were chosen by error on trips left out.",
    "",
    "How often the same methods name something on the residual of a real machine, where nothing is missing, is "
    "[on its own page](real-residual.md#other-methods-on-the-same-residuals).",
)


def missing_peers() -> list[str]:
    """Return the programs that are not installed."""
    from importlib.util import find_spec

    return [n for n in NEEDED if find_spec(n) is None]


def peer_trial(seed: int, hidden: Sequence[str], module: str = AXIS) -> PeerTrial:
    """Run every method and the study's own search on one case of a virtual machine, given by its module."""
    import time

    from discrepancy.study.study import Study
    from discrepancy.validation.peer_case import peer_case
    from discrepancy.validation.peer_methods import methods_on

    case = import_module(module).case(seed, list(hidden))
    study = Study(case.problem(seed=seed))
    begun = time.perf_counter()
    stage = study.stage
    calibrated = time.perf_counter()
    given = peer_case(stage)
    columns = time.perf_counter() - calibrated
    if any(h in given.dropped for h in hidden):
        return PeerTrial(seed=seed, hidden=tuple(hidden), note="not identifiable: recalibration imitates it entirely")
    answers: dict[str, dict[str, Any]] = {}
    for name, method in methods_on(given).items():
        start = time.perf_counter()
        try:
            answer: dict[str, Any] = asdict(method(given))
        except (ValueError, ArithmeticError, RuntimeError) as error:
            answer = {"named": [], "ties": [], "ratio": math.nan, "alarm": False, "failed": str(error)[:200]}
        answers[name] = {**answer, "seconds": time.perf_counter() - start}
    if hidden:
        true = [i for i, c in enumerate(given.candidates) if c.name in hidden]
        answers[TRUE] = {
            "named": list(hidden),
            "ties": [],
            "ratio": given.held_out(true),
            "alarm": True,
            "seconds": math.nan,
        }
    start = time.perf_counter()
    conclusion = study.diagnose()
    accepted = [s.accepted for s in study.stages if s.accepted is not None]
    before, after = study.stages[1].rmse("validate"), study.stages[-1].rmse("validate")
    answers[OURS] = {
        "named": [str(a.effect) for a in accepted],
        "ties": [f"{r.kind}@{r.where}" for r in accepted[0].rivals if r.indistinguishable] if accepted else [],
        "ratio": math.exp(sum(math.log(after[n] / before[n]) for n in after) / len(after)),
        "alarm": bool(accepted),
        "verdict": conclusion.verdict,
        "seconds": time.perf_counter() - start + calibrated - begun,
    }
    return PeerTrial(seed=seed, hidden=tuple(hidden), answers=answers, columns_seconds=columns)


# -------------------------------------------------------------------- the run


def _plan(trials: int, first: int, module: str) -> list[tuple[int, tuple[str, ...], str]]:
    import numpy as np

    names = [n for n in import_module(module).names() if n.partition("@")[0] != "unknown_force"]
    rng = np.random.default_rng(first)
    drawn = [str(n) for n in rng.choice(names, trials)]
    return [(first + k, hidden, module) for k in range(trials) for hidden in ((), (drawn[k],))]


def _run(task: tuple[int, tuple[str, ...], str]) -> PeerTrial:
    seed, hidden, _ = task
    try:
        return peer_trial(*task)
    except Exception as error:  # one case that fails must not lose the others
        return PeerTrial(seed=seed, hidden=hidden, note=f"failed: {type(error).__name__}: {error}"[:300])


def read_peers(path: Path) -> list[PeerTrial]:
    """Read the cases of an earlier run."""
    if not path.exists():
        return []
    rows = [json.loads(line) for line in path.read_text().splitlines() if line.strip()]
    return [PeerTrial(**{**r, "hidden": tuple(r["hidden"])}) for r in rows]


def run_peers(
    trials: int,
    out: Path,
    *,
    first: int = 1000,
    workers: int = 2,
    machine: str = "axis",
    module: str = AXIS,
    progress: Callable[[str], None] = lambda text: None,
) -> list[PeerTrial]:
    """Run the comparison, or what an earlier run left of it, and return all its cases.

    Parameters
    ----------
    trials : int
        Seeds; each gives a case with nothing hidden and one with one effect hidden.
    out : Path
        Folder of ``peers.jsonl``; of other machines than the axis their name stands before it.
    first : int
        First seed.
    workers : int
        Processes.
    machine, module : str
        Name of the virtual machine, and the module where it is.

    Raises
    ------
    ModuleNotFoundError
        If a program that is compared with is not installed.
    """
    from concurrent.futures import as_completed

    if lacking := missing_peers():
        raise ModuleNotFoundError(
            f"{' and '.join(lacking)} not installed: the comparison needs the extra, pip install 'vtsdt[peers]'"
        )
    out.mkdir(parents=True, exist_ok=True)
    path = out / file_name(machine, "peers")
    done = read_peers(path)
    known = {(t.seed, t.hidden) for t in done}
    left = [task for task in _plan(trials, first, module) if task[:2] not in known]
    with process_pool(workers) as pool, path.open("a") as stream:
        for count, ready in enumerate(as_completed([pool.submit(_run, task) for task in left]), 1):
            trial = ready.result()
            stream.write(json.dumps(asdict(trial)) + "\n")
            stream.flush()
            done.append(trial)
            ours = trial.answers.get(OURS, {})
            progress(
                f"peers {count}/{len(left)}: seed {trial.seed} {' + '.join(trial.hidden) or 'nothing'} hidden; "
                f"{trial.note or ', '.join(ours['named']) or 'nothing named'}"
            )
    return sorted(done, key=lambda t: (t.seed, t.hidden))


# -------------------------------------------------------------------- the table


def _same(named: str, hidden: str, method: str) -> bool:
    """Tell whether a name is the hidden effect; regression on states has one motion only, so places do not count."""
    return named == hidden or (method == "PySINDy on states" and named.split("@")[0] == hidden.split("@")[0])


def _median(values: Sequence[float]) -> float:
    import numpy as np

    kept = [v for v in values if v is not None and math.isfinite(v)]
    return float(np.median(kept)) if kept else math.nan


def peer_rates(trials: Sequence[PeerTrial]) -> list[dict[str, Any]]:
    """Return one row for each method: counts, cases, and medians."""
    counted = [t for t in trials if not t.note]
    quiet, full = ([t for t in counted if bool(t.hidden) is h] for h in (False, True))
    methods = list(dict.fromkeys(m for t in counted for m in t.answers))
    methods = [OURS, *(m for m in methods if m not in (OURS, TRUE)), *([TRUE] if TRUE in methods else [])]
    rows = []
    for m in methods:
        null, hit = ([t.answers[m] for t in part if m in t.answers] for part in (quiet, full))
        names = [(t.answers[m], t.hidden[0]) for t in full if m in t.answers]
        rows.append(
            {
                "method": m,
                "false alarms": (sum(a["alarm"] for a in null), len(null)),
                "alarm where one is hidden": (sum(a["alarm"] for a in hit), len(hit)),
                "truth named first": (
                    sum(bool(a["named"]) and _same(a["named"][0], h, m) for a, h in names),
                    len(names),
                ),
                "truth first or in its tie": (
                    sum(any(_same(n, h, m) for n in [*a["named"][:1], *a["ties"]]) for a, h in names),
                    len(names),
                ),
                "truth among those named": (
                    sum(any(_same(n, h, m) for n in [*a["named"], *a["ties"]]) for a, h in names),
                    len(names),
                ),
                "effects named": sum(len(a["named"]) for a in hit) / max(len(hit), 1),
                "held-out error": _median([a["ratio"] for a in hit]),
                "held-out error, nothing hidden": _median([a["ratio"] for a in null]),
                "seconds": _median([a["seconds"] for a in (*null, *hit)]),
            }
        )
    return rows


def peer_page(trials: Sequence[PeerTrial], date: str, machine: str = "axis") -> str:
    """Return the comparison on a virtual machine as a page (Markdown)."""
    from discrepancy.validation.peer_methods import GAUSSIAN_PROCESS, versions
    from discrepancy.validation.trials import wilson

    counted = [t for t in trials if not t.note]
    seeds = sorted({t.seed for t in trials})
    programs = ", ".join(f"{n} {v}" for n, v in versions().items())

    def share(pair: tuple[int, int]) -> str:
        hits, n = pair
        low, high = wilson(hits, n)
        return f"{hits}/{n} ({100 * low:.0f} to {100 * high:.0f} %)" if n else "–"

    def figure(value: float, digits: int = 2) -> str:
        return f"{value:.{digits}f}" if math.isfinite(value) else "–"

    from discrepancy.validation.peer_methods import METHODS

    asked = {n for t in counted for n in t.answers}
    where = "" if machine == "axis" else f": virtual {machine}"
    lines = [f"# Other methods on the same data{where}", "", *INTRODUCTION, "", "What was run:", ""]
    lines += [f"- **{n}**: {(f.__doc__ or '').split(chr(10))[0]}" for n, f in METHODS.items() if n in asked]
    option = "" if machine == "axis" else f" --machine {machine}"
    lines += [
        "",
        "## Rates",
        "",
        f"Made by `vtsdt validate discrepancy peers{option}` on {date}: virtual {machine}, "
        f"seeds {seeds[0]} to {seeds[-1]}, {sum(not t.hidden for t in counted)} cases with nothing hidden and "
        f"{sum(bool(t.hidden) for t in counted)} with one effect at its usual size. {programs}.",
        "",
        "| method | false alarms | alarm where one is hidden | truth named first | first or in its tie | "
        "among those named | effects named | held-out error, hidden | held-out error, nothing hidden | time, s |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in peer_rates(trials):
        named = row["method"] != GAUSSIAN_PROCESS
        if row["method"] == TRUE:
            lines.append(f"| {TRUE} | | | | | | 1 | {figure(row['held-out error'])} | | |")
            continue
        lines.append(
            f"| {row['method']} | {share(row['false alarms'])} | {share(row['alarm where one is hidden'])} | "
            + " | ".join(
                share(row[k]) if named else "names nothing"
                for k in ("truth named first", "truth first or in its tie", "truth among those named")
            )
            + f" | {row['effects named']:.1f} | {figure(row['held-out error'])} | "
            f"{figure(row['held-out error, nothing hidden'])} | {figure(row['seconds'], 1)} |"
        )
    lines += [
        "",
        "In brackets the 95 % interval of the rate (Wilson). Held-out error: median, on records that took no part, "
        "as a share of that of the recalibrated model. Time: median of a case, without the "
        f"{_median([t.columns_seconds for t in counted]):.0f} s for the sensitivities that the others were given; "
        "that of this program includes everything.",
    ]
    out = [t for t in trials if t.note]
    if out:
        lines += ["", "Cases that do not count:", ""]
        lines += [f"- seed {t.seed}, {' + '.join(t.hidden) or 'nothing'} hidden: {t.note}" for t in out]
    lines += ["", "## What this program named where one was hidden", ""]
    for t in counted:
        if t.hidden:
            ours = t.answers[OURS]
            ties = f" (not distinguished from {', '.join(ours['ties'])})" if ours["ties"] else ""
            lines.append(f"- seed {t.seed}, {t.hidden[0]}: {', '.join(ours['named']) or 'nothing'}{ties}")
    return "\n".join(lines)
