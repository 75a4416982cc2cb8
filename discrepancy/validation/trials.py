"""One line per case: what was hidden and what the search named; rates with their intervals, and the results page."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

__all__ = [
    "SUITES",
    "Trial",
    "file_name",
    "listed_as_negligible",
    "page",
    "rates",
    "read_trials",
    "wilson",
    "with_section",
]

SUITES = ("null", "kinds", "pairs", "triples", "masking", "unknown")
SEVERAL = ("pairs", "triples", "masking")  # suites in which every hidden effect must be named


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One case and what the search named.

    Parameters
    ----------
    suite : {"null", "kinds", "pairs", "triples", "masking", "unknown"}
    seed : int
    hidden : tuple of str
        ``kind@where``.
    verdict : str
    found : tuple of str
        ``kind@where`` of the effects added, in order.
    ties : tuple of str
        What could not be distinguished from the first.
    ratio : float
        Fitted strength over the true one, where kind and place are right.
    seconds : float
    note : str
        Why it was refused or failed.
    over, curve_over, depends_on : str
        What an unknown force depends on: in truth, by the curve that was added, and by the estimate over time.
    tied : tuple of str
        What could not be distinguished from any of the effects added.
    held_out : float
        Error on the held-out records over that of the model with the hidden effects, averaged over the outputs.
    inside : int
        For a model with exactly the hidden effects: how many 95 % intervals contain the true value.
    outside : tuple of str
        The parameters whose interval does not.
    """

    suite: str
    seed: int
    hidden: tuple[str, ...]
    verdict: str
    found: tuple[str, ...]
    ties: tuple[str, ...] = ()
    ratio: float = math.nan
    seconds: float = math.nan
    note: str = field(default="")
    over: str = ""
    curve_over: str = ""
    depends_on: str = ""
    tied: tuple[str, ...] = ()
    held_out: float = math.nan
    inside: int = 0
    outside: tuple[str, ...] = ()

    @property
    def first(self) -> bool:
        """True if the hidden effect was named first."""
        return bool(self.found) and self.found[0] in self.hidden

    @property
    def in_tie(self) -> bool:
        """True if the hidden effect is the first named or tied with it."""
        return bool(self.found) and bool({self.found[0], *self.ties} & set(self.hidden))

    @property
    def all_found(self) -> bool:
        """True if every hidden effect is named."""
        return set(self.hidden) <= set(self.found)

    @property
    def all_tied(self) -> bool:
        """True if every hidden effect is named, or cannot be distinguished from one that is."""
        return set(self.hidden) <= {*self.found, *self.ties, *self.tied}

    @property
    def missed(self) -> bool:
        """True if the answer is not the right one for its suite."""
        if self.suite == "null":
            return bool(self.found) or self.verdict == "unknown effect"
        if self.suite == "unknown":
            return self.verdict != "unknown effect" or self.over not in (self.curve_over, self.depends_on)
        return not (self.all_found if self.suite in SEVERAL else self.in_tie)


def wilson(hits: int, trials: int) -> tuple[float, float]:
    """Return the 95 % Wilson interval of a rate.

    Examples
    --------
    >>> low, high = wilson(2, 100)
    >>> round(low, 4), round(high, 4)
    (0.0055, 0.07)
    """
    if trials == 0:
        return 0.0, 1.0
    z = 1.959963984540054
    rate, n = hits / trials, trials
    middle = (rate + z * z / (2 * n)) / (1 + z * z / n)
    half = z * math.sqrt(rate * (1 - rate) / n + z * z / (4 * n * n)) / (1 + z * z / n)
    return max(0.0, middle - half), min(1.0, middle + half)


def read_trials(path: Path) -> list[Trial]:
    """Read the trials of an earlier run."""
    if not path.exists():
        return []
    rows: list[dict[str, Any]] = [json.loads(line) for line in path.read_text().splitlines() if line.strip()]
    for row in rows:
        row |= {k: tuple(row[k]) for k in ("hidden", "found", "ties", "tied", "outside") if k in row}
    return [Trial(**row) for row in rows]


def rates(trials: Iterable[Trial]) -> list[tuple[str, int, int]]:
    """Return rows (what, hits, trials) of one suite."""
    trials = list(trials)
    if not trials:
        return []
    suite, n = trials[0].suite, len(trials)
    if suite == "null":
        return [("false alarms", sum(t.missed for t in trials), n), *_coverage(trials)]
    if suite == "unknown":
        return [
            ("verdict 'unknown effect'", sum(t.verdict == "unknown effect" for t in trials), n),
            ("a wrong name", sum(t.verdict in ("effect found", "ambiguous", "partly explained") for t in trials), n),
            *_right_axis(trials),
        ]
    if suite in SEVERAL:
        word = "all three" if suite == "triples" else "both"
        return [
            (f"{word} named", sum(t.all_found for t in trials), n),
            (f"{word} named or tied with what is named", sum(t.all_tied for t in trials), n),
            *_held_out(trials),
            *_coverage(trials),
        ]
    counted = [t for t in trials if t.verdict != "refused"]
    rows = [
        ("found (something is named)", sum(bool(t.found) for t in counted), len(counted)),
        ("truth named first", sum(t.first for t in counted), len(counted)),
        ("truth in the tie set", sum(t.in_tie for t in counted), len(counted)),
        (
            "strength within 20 %",
            sum(abs(t.ratio - 1) <= 0.2 for t in counted if t.first),
            sum(t.first for t in counted),
        ),
        *_held_out(counted),
        *_coverage(counted),
    ]
    for name in dict.fromkeys(t.hidden[0] for t in counted):
        of = [t for t in counted if t.hidden[0] == name]
        rows.append((f"{name}: truth in the tie set", sum(t.in_tie for t in of), len(of)))
    return rows


def _held_out(trials: Sequence[Trial]) -> list[tuple[str, int, int]]:
    """Return how often the held-out error is that of the true model, where that was computed."""
    known = [t.held_out for t in trials if math.isfinite(t.held_out)]
    return [("held-out error within 5 % of the true model's", sum(h <= 1.05 for h in known), len(known))] * bool(known)


def _coverage(trials: Sequence[Trial]) -> list[tuple[str, int, int]]:
    """Return how many 95 % intervals contain the true value, in trials that ended with exactly the hidden effects."""
    inside, outside = sum(t.inside for t in trials), sum(len(t.outside) for t in trials)
    right = sum(bool(t.inside or t.outside) for t in trials)
    return [(f"95 % intervals with the true value in them ({right} trials)", inside, inside + outside)] * bool(right)


def _right_axis(trials: Sequence[Trial]) -> list[tuple[str, int, int]]:
    """Return how often an unknown force is attributed to the right variable."""
    from discrepancy.effects.uncatalogued_laws import OVER

    rows = []
    for over in OVER:
        called = [t for t in trials if t.over == over and t.verdict == "unknown effect"]
        rows += [
            (f"over {over}: verdict", len(called), sum(t.over == over for t in trials)),
            (f"over {over}: curve over {over}", sum(t.curve_over == over for t in called), len(called)),
            (f"over {over}: estimate depends on {over}", sum(t.depends_on == over for t in called), len(called)),
        ]
    return rows


def listed_as_negligible(negligible: Sequence[tuple[str, str, float, float, float, str]], hidden: Sequence[str]) -> str:
    """Return a note on hidden effects that were significant but too small to matter.

    Parameters
    ----------
    negligible : sequence of tuple
        As in `discrepancy.conclusion.conclusion.Conclusion`.
    hidden : sequence of str

    Examples
    --------
    >>> listed_as_negligible([("sensor_drift", "F_cw", 0.0457, 0.0022, 3e-8, "N/s")], ["sensor_drift@F_cw"])
    'sensor_drift@F_cw is reported as present but too small to matter (p = 3e-08)'
    """
    names = {f"{kind}@{where}": p for kind, where, _, _, p, _ in negligible}
    notes = [f"{n} is reported as present but too small to matter (p = {names[n]:.1g})" for n in hidden if n in names]
    return "; ".join(notes)


def file_name(machine: str, suite: str) -> str:
    """Return the name of the file of a suite's trials."""
    return f"{suite}.jsonl" if machine == "axis" else f"{machine}-{suite}.jsonl"


def with_section(page_text: str, machine: str, results: str) -> str:
    """Return a page with a machine's results replaced; the rest of the page stays.

    Examples
    --------
    >>> with_section("# Rates\\n", "lift", "# Title\\n\\nMade today.\\n\\n## null\\n\\nNone.")
    '# Rates\\n\\n<!-- lift -->\\n## Virtual lift\\n\\nMade today.\\n\\n### null\\n\\nNone.\\n<!-- /lift -->\\n'
    """
    import re

    body = re.sub("^## ", "### ", results.partition("\n")[2].strip(), flags=re.MULTILINE)
    section = f"<!-- {machine} -->\n## Virtual {machine}\n\n{body}\n<!-- /{machine} -->\n"
    known = re.compile(rf"<!-- {machine} -->.*?<!-- /{machine} -->\n", re.DOTALL)
    if known.search(page_text):
        return known.sub(lambda found: section, page_text)
    return page_text.rstrip() + "\n\n" + section


def _listed(seeds: Sequence[int]) -> str:
    """Return increasing numbers as text; consecutive ones as a range.

    Examples
    --------
    >>> _listed([3, 4, 5, 9])
    '3 to 5, 9'
    """
    rows: list[list[int]] = []
    for seed in seeds:
        if rows and seed == rows[-1][-1] + 1:
            rows[-1].append(seed)
        else:
            rows.append([seed])
    return ", ".join(str(r[0]) if len(r) == 1 else f"{r[0]} to {r[-1]}" for r in rows)


def page(out: Path, date: str, machine: str = "axis") -> str:
    """Return the results page (Markdown) of all suites of a machine in a folder."""
    command = "vtsdt validate discrepancy" + ("" if machine == "axis" else f" --machine {machine}")
    lines = [
        "# How often the search is right",
        "",
        f"Made by `{command}` on {date}; virtual {machine}.",
        "",
    ]
    for suite in SUITES:
        trials = read_trials(out / file_name(machine, suite))
        if not trials:
            continue
        seeds = sorted({t.seed for t in trials})
        lines += [
            f"## {suite}",
            "",
            f"Seeds {_listed(seeds)}.",
            "",
            "| | hits | trials | rate | 95 % interval |",
            "|---|---|---|---|---|",
        ]
        for what, hits, n in rates(trials):
            low, high = wilson(hits, n)
            lines.append(f"| {what} | {hits} | {n} | {hits / max(n, 1):.1%} | {low:.1%} to {high:.1%} |")
        lines += ["", "Misses:", ""]
        for t in trials:
            if t.missed:
                named, note = ", ".join(t.found) or "nothing", " ".join(t.note.split())
                lines.append(
                    f"- seed {t.seed}, {' + '.join(t.hidden) or 'nothing'} hidden: {t.verdict}, named {named}. {note}"
                    + (f" True over {t.over}, curve over {t.curve_over or 'nothing'}." if t.over else "")
                )
        lines.append("")
    return "\n".join(lines)
