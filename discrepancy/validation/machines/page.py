"""The page of a run on the machines: how often the search was right, and what it cost."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from statistics import median

from discrepancy.validation.machines.reliability import brier_score, calibration_error, jeffreys

__all__ = ["counts", "page", "statements"]

Row = dict[str, str]
VISIBLE = 100.0  # nats from which an effect is plain enough to be asked for by its name
#: Between these, single effects are counted by the evidence for the truth, nats: from below a Bayes factor of exp 10 to
#: plain; the same steps as those of the grades.
EVIDENCE = (-math.inf, 10.0, 30.0, VISIBLE, math.inf)


def counts(rows: Sequence[Row]) -> list[tuple[str, int, int]]:
    """Return what is counted: its name, the hits and the trials."""
    graded = [r for r in rows if r["category"]]
    named = [r for r in graded if r["category"] == "single"]
    plain = [r for r in named if float(r["nats"]) >= VISIBLE]
    faint = [r for r in named if float(r["nats"]) < VISIBLE]
    weighed = [r for r in named if r.get("evidence")]

    def count(name: str, of: Sequence[Row], hit: Callable[[Row], bool]) -> tuple[str, int, int]:
        return name, sum(map(hit, of)), len(of)

    def of(category: str) -> list[Row]:
        return [r for r in graded if r["category"] == category]

    def flag(column: str) -> Callable[[Row], bool]:
        return lambda row: row[column] == "1"

    by_evidence = []
    for low, high in reversed(list(pairwise(EVIDENCE))):
        rows_between = [r for r in weighed if low <= float(r["evidence"]) < high]
        text = f"evidence for the truth {_between(low, high)}"
        by_evidence.append(count(f"truth first, {text}", rows_between, flag("first")))
        by_evidence.append(count(f"truth in the set, {text}", rows_between, flag("in_set")))

    return [
        count("right", graded, flag("right")),
        count("nothing missing, and the answer says so", of("none"), flag("right")),
        count(f"truth first, {VISIBLE:g} nats or more", plain, flag("first")),
        count(f"truth in the set, {VISIBLE:g} nats or more", plain, flag("in_set")),
        count(f"truth in the set, below {VISIBLE:g} nats", faint, flag("in_set")),
        count(f"a confident wrong name, below {VISIBLE:g} nats", faint, flag("confident_wrong")),
        *by_evidence,
        count("cases with effects named that are not there", graded, lambda r: int(r["invented"] or 0) > 0),
        count("outside the catalogue, reported as unknown", of("outside"), flag("unknown")),
        count("outside the catalogue, a wrong name", of("outside"), lambda r: int(r["invented"] or 0) > 0),
        count("pairs, both in the set", of("pair"), flag("in_set")),
        count("masking pairs, both in the set", of("masking"), flag("in_set")),
        count("an output worse held out", graded, flag("worse")),
        count("no answer within the limits", graded, lambda r: r["answer"] == "none"),
    ]


def _between(low: float, high: float) -> str:
    """Return a range of nats in words.

    Examples
    --------
    >>> _between(-math.inf, 10.0), _between(30.0, 100.0), _between(100.0, math.inf)
    ('below 10 nats', '30 to 100 nats', '100 nats or more')
    """
    if math.isinf(low):
        return f"below {high:g} nats"
    return f"{low:g} nats or more" if math.isinf(high) else f"{low:g} to {high:g} nats"


def statements(rows: Sequence[Row]) -> tuple[list[float], list[int]]:
    """Return the probabilities that were shown, and whether they came true."""
    said = [each for row in rows if row["statements"] for each in json.loads(row["statements"])]
    return [p for _, p, _ in said], [true for _, _, true in said]


def page(rows: Sequence[Row], *, date: str, final: bool, further: Sequence[str] = ()) -> str:
    """Return the page (Markdown); further lines stand before the list of cases."""
    codes = ", ".join(sorted({row["code"] for row in rows}))
    seeds = "final seeds, run once" if final else "development seeds: fixes may have been made with them"
    machines = sorted({row["machine"] for row in rows})
    lines = [
        "# The search on machines of plain equations",
        "",
        f"{date}, code {codes}, {seeds}. Machines: {', '.join(machines)}.",
        "",
        "| | hits | trials | rate | 95 % interval |",
        "|---|---|---|---|---|",
    ]
    for name, hits, trials in counts(rows):
        if trials:
            low, high = jeffreys(hits, trials)
            lines.append(f"| {name} | {hits} | {trials} | {hits / trials:.1%} | {low:.1%} to {high:.1%} |")
    shown, true = statements(rows)
    sizes = [float(r["set_size"]) for r in rows if r["set_size"] and float(r["set_size"]) > 0.0]
    ratios = [float(r["held_out"]) for r in rows if r["held_out"]]
    seconds = [float(r["processor_s"]) for r in rows if r["processor_s"]]
    megabytes = [float(r["peak_MB"]) for r in rows if r["peak_MB"]]
    lines += ["", "| | median | largest |", "|---|---|---|"]
    for name, values, form in (
        ("names in the set of an effect", sizes, ".0f"),
        ("held-out error over the achievable", ratios, ".3g"),
        ("processor time, s", seconds, ".0f"),
        ("peak memory, MB", megabytes, ".0f"),
    ):
        if values:
            lines.append(f"| {name} | {median(values):{form}} | {max(values):{form}} |")
    if shown:
        text = f"{len(shown)} statements with a probability: calibration error {calibration_error(shown, true):.3f}, "
        lines += ["", text + f"Brier score {brier_score(shown, true):.3f}."]
    if further:
        lines += ["", *further]
    lines += [
        "",
        "## Cases",
        "",
        "| case | hidden | evidence for it, nats | verdict | named | right | s | MB |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        cells = (
            row["case"],
            row["hidden"],
            row.get("evidence", ""),
            row["answer"],
            row["named"],
            row["right"],
            row["processor_s"],
            row["peak_MB"],
        )
        lines.append("| " + " | ".join(cell or "–" for cell in cells) + " |")
    return "\n".join(lines) + "\n"
