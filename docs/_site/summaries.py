"""The short tables of the pages that readers see first, taken from the pages that the measurements write.

``python -m docs._site.summaries`` writes them anew after a measurement, between ``<!-- summary -->`` and
``<!-- /summary -->``; `tests/unit/test_site.py` fails where that was forgotten.
"""

from __future__ import annotations

import re
from pathlib import Path

from discrepancy.validation.trials import wilson

DOCS = Path(__file__).resolve().parents[1]
MARKED = re.compile(r"(<!-- summary -->\n).*?(<!-- /summary -->)", re.DOTALL)

TIMES = (  # what a reader asks, the section of the page of computing times, the beginning of the entry's name
    ("6 s of the virtual axis, sampled at 1 kHz", "simulate", "compiled Dormand-Prince"),
    ("a 6 s trip of the lift with 17 states", "trip_17", "solve_ivp, default method"),
    ("a 6 s trip of the lift with 37 states", "trip_37", "solve_ivp, default method"),
    ("the same trip in C written by hand", "trip_37", "C by hand, gcc -O3 -march=native"),
    ("the same trip by SciPy's fastest method", "trip_37", "SciPy LSODA"),
    ("a hundred different trips with 37 states, on two processors", "batch", "100 trips as a batch on two threads"),
    ("one second of the gear stage with 58 states", "gear_second", "Table 2"),
    ("a new process to the end of its first trip with 37 states", "start", "a new process"),
    ("the same with an empty cache: everything is compiled", "start", "the same with an empty cache"),
    ("the search for what is missing, virtual axis, six records", "diagnose", "whole diagnosis"),
    ("the same, lift with 17 states, ten trips", "diagnose_17", "the same with one effect hidden"),
)
MACHINES = {"axis": "axis", "lift-1d": "1D lift", "reference": "reference lift", "gear": "gear stage"}
INTERVALS = "95 % intervals with the true value in them"
RATES = (  # what a reader asks, the suite, the beginning of the row; "": of all suites
    ("nothing is hidden, and something is named", "null", "false alarms"),
    ("one effect is hidden: named first", "kinds", "truth named first"),
    ("… named, or tied with what is named", "kinds", "truth in the tie set"),
    ("… its strength is within 20 %", "kinds", "strength within 20 %"),
    ("… the error on held-out records is within 5 % of the true model's", "kinds", "held-out error within 5 %"),
    ("two effects: both named or tied", "pairs", "both named or tied"),
    ("three effects: all named or tied", "triples", "all three named or tied"),
    ("two effects that mask each other: both named or tied", "masking", "both named or tied"),
    ("a force that no law describes: reported as unknown", "unknown", "verdict 'unknown effect'"),
    ("… given a wrong name", "unknown", "a wrong name"),
    ("95 % intervals contain the true value", "", INTERVALS),
)


def cells(text: str) -> list[list[str]]:
    """Return the rows of all tables in a text, each as its cells."""
    return [[c.strip() for c in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")]


def times_table(page: str) -> str:
    """Return the times of `TIMES` from the page of computing times."""
    sections = dict(re.findall(r"^<!-- (\w+) -->\n(.*?)(?=^<!-- |\Z)", page, re.MULTILINE | re.DOTALL))
    lines = ["| what | median | half of all between |", "|---|---:|---:|"]
    for what, subject, beginning in TIMES:
        row = next(c for c in cells(sections[subject]) if c[0].startswith(beginning))
        lines.append(f"| {what} | {row[1]} | {row[2].replace(' to ', ' and ')} |")
    return "\n".join(lines)


def rates_table(page: str) -> str:
    """Return the rates of `RATES` for each machine from the page of the trials, with Wilson's 95 % intervals."""
    lines = [f"| | {' | '.join(MACHINES.values())} |", "|---|" + "---|" * len(MACHINES)]
    for what, suite, beginning in RATES:
        row = []
        for machine in MACHINES:
            marks = (f"<!-- {machine}-present -->", f"<!-- /{machine}-present -->")
            section = page[page.index(marks[0]) : page.index(marks[1])]
            if suite:
                section = next((part for part in section.split("\n### ") if part.startswith(suite)), "")
            counts = [(int(c[1]), int(c[2])) for c in cells(section) if c[0].startswith(beginning)]
            hits, trials = (sum(column) for column in zip(*counts, strict=True)) if counts else (0, 0)
            low, high = wilson(hits, trials)
            row.append(f"{hits}/{trials} ({100 * low:.0f}–{100 * high:.0f}\u00a0%)" if trials else "–")
        lines.append(f"| {what} | {' | '.join(row)} |")
    return "\n".join(lines)


SUMMARIES = {
    "benchmarks/index.md": ("benchmarks/computing-times.md", times_table),
    "method/error-rates.md": ("method/error-rates-trials.md", rates_table),
}


def with_summary(name: str) -> str:
    """Return a page with its table as the measurements have it now."""
    source, table = SUMMARIES[name]
    text = table((DOCS / source).read_text(encoding="utf-8"))
    return MARKED.sub(lambda m: f"{m[1]}{text}\n{m[2]}", (DOCS / name).read_text(encoding="utf-8"))


if __name__ == "__main__":
    for name in SUMMARIES:
        (DOCS / name).write_text(with_summary(name), encoding="utf-8")
        print(f"table of docs/{name} written")
