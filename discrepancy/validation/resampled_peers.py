"""Other methods on the resampled residual of a real machine: how often they name something where nothing is missing.

Each gets what the scan has in the same trial: the residual with calibration projected out, and the sensitivities of the
candidates.  Whatever it names is a false alarm.  Two methods that need more are left out: PySINDy on states needs
measured states and their derivative, while a resampled residual is of outputs and has seams that a derivative would
see; the Gaussian process names nothing.
"""

from __future__ import annotations

import json
import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from discrepancy.statistics.blocks import Candidate, Residual
from discrepancy.validation.peer_comparison import OURS

if TYPE_CHECKING:
    from discrepancy.validation.peer_case import RegressionData
    from discrepancy.validation.resampled import Resampled, ResamplingData

__all__ = ["ResampledPeers", "read_resampled_peers", "resampled_case", "resampled_peers", "resampled_peers_page"]

#: Ridge of STLSQ in PySINDy where its user sets none, and the threshold.
RIDGE, THRESHOLD = 0.05, 0.1


@dataclass(frozen=True)
class ResampledPeers:
    """One resampled residual and what every method named.

    Parameters
    ----------
    number : int
        Seed of the resampling, as in `Resampled`.
    scheme : str
    answers : dict
        Method → named, ties, seconds.
    thresholds : dict
        Threshold of STLSQ → what it names with it, at PySINDy's own ridge.
    """

    number: int
    scheme: str
    answers: dict[str, dict[str, Any]] = field(default_factory=dict)
    thresholds: dict[str, list[str]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class ResampledCase:
    """One trial as the other methods see it, without held-out records."""

    candidates: tuple[Candidate, ...]
    plain: RegressionData
    white: RegressionData

    def held_out(self, named: Sequence[int]) -> float:
        """Return not-a-number."""
        return math.nan


def resampled_case(given: ResamplingData, made: Residual) -> ResampledCase:
    """Return what the other methods get of one resampled residual."""
    from discrepancy.statistics.whitened import fit_whitened
    from discrepancy.validation.peer_case import regression_data

    plain = given.plain(made)
    white = fit_whitened(made, given.sens, given.candidates, 24, 2, 2, plain)
    return ResampledCase(given.candidates, *(regression_data(w, given.candidates) for w in (plain, white)))


def resampled_peers(
    given: ResamplingData,
    trials: int,
    out: Path,
    *,
    seed: int = 0,
    progress: Callable[[str], None] = lambda text: None,
) -> list[ResampledPeers]:
    """Run every method on the same residuals as `resampled_alarms`; an interrupted run continues.

    Parameters
    ----------
    given : ResamplingData
        Of the best model.
    trials : int
    out : Path
        Folder of ``resampled_peers.jsonl``.
    seed : int
        First number.
    """
    from discrepancy.validation.peer_methods import REGRESSION_METHODS, THRESHOLDS, stlsq_at

    out.mkdir(parents=True, exist_ok=True)
    path = out / "resampled_peers.jsonl"
    done = read_resampled_peers(path)
    left = sorted(set(range(seed, seed + trials)) - {t.number for t in done})
    with path.open("a") as stream:
        for count, number in enumerate(left, 1):
            scheme, made = given.draw(number)
            case = resampled_case(given, made)
            answers: dict[str, dict[str, Any]] = {}
            for name, method in REGRESSION_METHODS.items():
                start = time.perf_counter()
                answer = method(case)
                spent = time.perf_counter() - start
                answers[name] = {"named": list(answer.named), "ties": list(answer.ties), "seconds": spent}
            thresholds = {f"{t:g}": list(stlsq_at(case, t, RIDGE).named) for t in sorted({*THRESHOLDS, THRESHOLD})}
            trial = ResampledPeers(number, scheme, answers, thresholds)
            stream.write(json.dumps(asdict(trial)) + "\n")
            stream.flush()
            done.append(trial)
            quiet = [n for n, a in answers.items() if not a["named"]]
            progress(f"other methods {count}/{len(left)}, {scheme}: nothing named by {'; '.join(quiet) or 'none'}")
    return sorted(done, key=lambda t: t.number)


def read_resampled_peers(path: Path) -> list[ResampledPeers]:
    """Read the trials of an earlier run."""
    if not path.exists():
        return []
    return [ResampledPeers(**json.loads(line)) for line in path.read_text().splitlines() if line.strip()]


# -------------------------------------------------------------------- the table


def resampled_peers_page(
    trials: Sequence[ResampledPeers], ours: Sequence[Resampled], versions: Mapping[str, str], date: str
) -> str:
    """Return the comparison as a section (Markdown).

    Parameters
    ----------
    trials : sequence of ResampledPeers
    ours : sequence of Resampled
        What this program found; trials that only one of the two has do not count.
    versions : mapping of str to str
        Of the programs compared.
    date : str
    """
    mine = {t.number: t for t in ours}
    both = [t for t in trials if t.number in mine]
    schemes = list(dict.fromkeys(t.scheme for t in sorted(both, key=lambda t: t.scheme)))
    named: dict[str, list[tuple[str, Sequence[str]]]] = {
        OURS: [(t.scheme, [x for m in [mine[t.number]] for x in (m.plain, m.whitened, m.curves) if x]) for t in both]
    }
    for method in dict.fromkeys(m for t in both for m in t.answers):
        named[method] = [(t.scheme, t.answers[method]["named"]) for t in both if method in t.answers]
    lines = [
        f"Made by the same command with `--peers` on {date}, numbers {min(t.number for t in both)} to "
        f"{max(t.number for t in both)}; {', '.join(f'{n} {v}' for n, v in versions.items())}.",
        "",
        "| | alarms | trials | rate | 95 % interval | "
        + " | ".join(f"of {s}" for s in schemes)
        + " | named where it alarms | most often |",
        "|---|---|---|---|---|" + "---|" * (len(schemes) + 2),
    ]
    lines += [_row(method, answers, schemes) for method, answers in named.items()]
    lines += [
        "",
        f"PySINDy's STLSQ with a threshold that is set beforehand; ridge {RIDGE:g}, which is PySINDy's own, as the "
        f"threshold {THRESHOLD:g} is. Columns and residual have length one.",
        "",
        "| threshold | alarms | trials | rate | 95 % interval |",
        "|---|---|---|---|---|",
    ]
    for value in dict.fromkeys(v for t in both for v in t.thresholds):
        part = [t.thresholds[value] for t in both if value in t.thresholds]
        lines.append("| " + " | ".join([value, *_share(sum(bool(n) for n in part), len(part))]) + " |")
    return "\n".join(lines)


def _row(method: str, answers: Sequence[tuple[str, Sequence[str]]], schemes: Sequence[str]) -> str:
    import numpy as np

    with_names = [n for _, n in answers if n]
    cells = [method, *_share(len(with_names), len(answers))]
    for scheme in schemes:
        part = [n for s, n in answers if s == scheme]
        cells.append(f"{sum(bool(n) for n in part)}/{len(part)}")
    first = Counter(name for names in with_names for name in names)
    most = ", ".join(f"{name} {count}" for name, count in first.most_common(2))
    cells += [f"{np.median([len(n) for n in with_names]):g}" if with_names else "–", most or "–"]
    return "| " + " | ".join(cells) + " |"


def _share(hits: int, n: int) -> list[str]:
    from discrepancy.validation.trials import wilson

    low, high = wilson(hits, n)
    return [str(hits), str(n), f"{hits / max(n, 1):.1%}", f"{low:.1%} to {high:.1%}"]
