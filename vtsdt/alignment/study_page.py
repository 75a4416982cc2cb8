"""The page of the study of the alignment sensor: tables, rates with intervals, and a reason for every miss."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from vtsdt.alignment.score import CORRELATION, HEIGHTS, RMS, Score
from vtsdt.alignment.study import BASE, FRESH, MORE, Judged, lines
from vtsdt.alignment.study import CALM as UNDISTURBED
from vtsdt.alignment.virtual_lifts import CALM, INTRODUCED, SCALING

__all__ = ["page", "rate"]


def rate(good: int, of: int) -> str:
    """Return a share with its 95 % interval after Clopper and Pearson.

    Examples
    --------
    >>> rate(9, 10)
    '9 of 10 (55 to 100 %)'
    """
    from scipy.stats import beta

    low = beta.ppf(0.025, good, of - good + 1) if good else 0.0
    high = beta.ppf(0.975, good + 1, of - good) if good < of else 1.0
    return f"{good} of {of} ({100 * low:.0f} to {100 * high:.0f} %)"


def page(lifts: Sequence[Judged], command: str) -> str:
    """Return the results as a page of the documentation.

    Parameters
    ----------
    lifts : sequence of Judged
    command : str
        That made them.
    """
    told = ["# Guide alignment on the virtual lift", "", *_words(lifts, command), "", *_by_lift(lifts), ""]
    told += [*_rates(lifts), "", "## What was missed, and why", "", *_misses(lifts), "", *_by_line(lifts)]
    return "\n".join(told) + "\n"


def _words(lifts: Sequence[Judged], command: str) -> list[str]:
    seen = [str(c.seed) for c in lifts if c.seed < FRESH]
    return [
        f"Written by `{command}`. The data are synthetic; the estimator never sees the truth. Lifts with the seeds "
        f"{', '.join(str(c.seed) for c in lifts)}, ten trips from end to end each, recorded at 1 kHz with everything "
        "that the cabin model lacks: both rails bent in both directions, a disturbing force of 1 N, mass, friction and "
        "contact stiffness that are not the nominal ones, sensor noise and offsets. "
        + (
            f"The method was made with the lifts {', '.join(seen)} in sight."
            if seen
            else "No part of the method was chosen or adjusted on these lifts."
        ),
        "",
        "The true equivalent deviation is that of a single rail which presses the shoes as hard as all rails of the "
        "lift do: the normal forces of the true cabin at rest at each height, over its contact stiffness. That is what "
        "friction can tell. It is the sum of both rails' deviations in x, averaged over the heights of the lower and "
        "upper shoes, as long as all shoes press; where a level of shoes is loose it is more, because a shoe cannot "
        "press by less than nothing and a cabin whose centre of mass is off its ropes leans on it all the same. No "
        "sensor of the trips could tell the two apart. Correlations with the sum in x "
        f"alone stand beside. Counted are heights of the cabin's floor from {HEIGHTS[0]:g} to {HEIGHTS[1]:g} m.",
        "",
        f"The paper's scaling: the right rail was moved by {1e3 * INTRODUCED:g} mm as a whole, {SCALING} trips were "
        "recorded before and after, and the friction coefficient of the filter was scaled until δ grew by as much. "
        "None of these trips is among those that are judged, and every trip meets a disturbing force of its own.",
    ]


def _by_lift(lifts: Sequence[Judged]) -> list[str]:
    told = [
        "## Ten trips, lift by lift",
        "",
        "| lift | true friction μ K over nominal | factor found by the scaling | true mass over nominal | spread of "
        "the true deviation over height [mm] | correlation | of the median | with x alone | expected from the trips | "
        f"{CALM} trips without the disturbing force | 20 trips | RMS error [mm] | mean error [mm] | false | missed | "
        "heights told right | truth within 95 % of the estimate |",
        "|---|" + "---:|" * 16,
    ]
    for lift in lifts:
        cells = [f"{lift.friction:.3f}", f"{lift.factor:.3f}", f"{lift.mass:.4f}", f"{1e3 * lift.spread:.2f}"]
        one = lift.score(BASE)
        if one is None:
            told.append(f"| {lift.seed} | {' | '.join(cells)} | refused {'| ' * 11}|")
            continue
        beside = [lift.score(what) for what in (UNDISTURBED, MORE)]
        cells += [
            f"{one.correlation:.3f}", f"{one.median:.3f}", f"{_or_nan(one.in_plane):.3f}",
            f"{_or_nan(one.expected):.3f}", *("" if s is None else f"{s.correlation:.3f}" for s in beside),
            f"{1e3 * one.rms:.2f}", f"{1e3 * one.level:+.2f}", f"{one.false}", f"{one.missed}", f"{one.right:.0%}",
            f"{_or_nan(one.covered):.0%}",
        ]  # fmt: skip
        told.append(f"| {lift.seed} | {' | '.join(cells)} |")
    return told


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else value


def _rates(lifts: Sequence[Judged]) -> list[str]:
    """Return how often what is asked for is reached, with intervals."""
    known = [s for s in (lift.score(BASE) for lift in lifts) if s is not None]
    asked: tuple[tuple[str, Callable[[Score], bool]], ...] = (
        (f"correlation of the estimate at least {CORRELATION:g}", lambda s: s.correlation >= CORRELATION),
        (f"correlation of the median over trips at least {CORRELATION:g}", lambda s: s.median >= CORRELATION),
        (f"RMS error at most {1e3 * RMS:g} mm", lambda s: s.rms <= RMS),
        ("at most one false and one missed section", lambda s: s.false <= 1 and s.missed <= 1),
        ("no false and no missed section", lambda s: s.false + s.missed == 0),
        ("estimate: correlation, error and sections together", lambda s: s.good),
    )
    told = ["| what is asked of ten trips | lifts (95 % of Clopper and Pearson) |", "|---|---|"]
    told += [f"| {words} | {rate(sum(map(test, known)), len(lifts))} |" for words, test in asked]
    off = np.array([lift.factor / lift.friction - 1.0 for lift in lifts])
    off = 100 * off[np.isfinite(off)]
    if off.size:
        told += [
            "",
            f"The scaling by the rail that was moved leaves the friction {np.sqrt(np.mean(off**2)):.0f} % off in the "
            f"root mean square and {np.abs(off).max():.0f} % at worst: its trips meet forces of their own, too. "
            "An error of the friction moves the whole estimate, and with it the edges of sections, but no correlation.",
        ]
    covered = [s.covered for s in known if s.covered is not None]
    if covered:
        told += [
            "",
            f"Over all lifts the truth is within 1.96 standard deviations of the estimate at {np.mean(covered):.0%} of "
            "the heights; the standard deviation comes from the spread of the trips and knows no error that all trips "
            "share, as one of the friction's scale.",
        ]
    return told


def _misses(lifts: Sequence[Judged]) -> list[str]:
    """Return every lift that falls short, and every section that is wrong, with its numbers."""
    told = []
    for lift in lifts:
        one = lift.score(BASE)
        if one is None:
            refused = next((v for k, v in lift.found.items() if k.endswith(BASE)), "not run")
            told.append(f"- Lift {lift.seed}: {refused}")
            continue
        parts = [_why_short(lift, one)] if one.short() else []
        if one.median < CORRELATION:
            parts.append(
                f"the plain median over the trips follows with {one.median:.3f}, the median over their pairs with "
                f"{one.correlation:.3f}: of errors that differ from trip to trip it leaves half as much variance again"
            )
        parts += [wrong.reason() for wrong in one.wrong]
        if one.wrong and np.isfinite(lift.factor):
            parts.append(
                f"The whole estimate of this lift is off by {1e3 * one.level:+.2f} mm, its friction having been scaled "
                f"{100 * (lift.factor / lift.friction - 1.0):+.0f} % off the true one"
            )
        if parts:
            told.append(f"- Lift {lift.seed}: " + ". ".join(parts) + ".")
    return told or ["Nothing."]


def _why_short(lift: Judged, one: Score) -> str:
    """Return what a lift falls short of, and what the same lift gives without the force and with more trips."""
    told = f"falls short with {', '.join(one.short())}; its deviation varies by {1e3 * lift.spread:.2f} mm over height"
    for what, words in ((UNDISTURBED, f"{CALM} trips without the disturbing force"), (MORE, "20 trips")):
        other = lift.score(what)
        if other is not None:
            reached = "reach it" if other.good else f"fall short, too ({', '.join(other.short())})"
            told += f"; {words} {reached}: correlation {other.correlation:.3f}, error {1e3 * other.rms:.2f} mm"
    return told


def _by_line(lifts: Sequence[Judged]) -> list[str]:
    told = [
        "## How it degrades",
        "",
        "Correlation and error of the estimate: mean over the lifts, and the worst of them; false and missed: sections "
        "beyond 2.3 mm, mean of the lifts and the most. Errors are added to those that the records have already. "
        f'"20 trips" and "{UNDISTURBED}" stand for the lifts that take all lines and for those that fall short. '
        '"refused": lifts whose trips the command refuses with its reason. "reached": lifts with correlation, error '
        "and sections as asked, with its 95 % interval. Each tuning has its own scaling.",
        "",
        "| what was done | | reached | correlation | worst | of the median | worst | RMS error [mm] | worst | false | "
        "missed | heights told right | refused |",
        "|---|---|---|---:|---:|---:|---:|---:|---:|---|---|---:|---:|",
    ]
    refusals: dict[str, list[int]] = {}
    rows = [(line, line.what, lifts) for line in lines()]
    full = [lift for lift in lifts if all(line.name in lift.found for line in lines())]
    if full and len(full) < len(lifts):
        rows.insert(1, (rows[0][0], f"the same, lifts {', '.join(str(c.seed) for c in full)} alone", full))
    for line, words, taken in rows:
        found = [(lift.seed, lift.found[line.name]) for lift in taken if line.name in lift.found]
        if not found:
            continue
        known = [s for _, s in found if isinstance(s, Score)]
        for seed, why in found:
            if isinstance(why, str):
                refusals.setdefault(f"{line.group}, {line.what}: {_sort(why)}", []).append(seed)
        start = f"| {line.group} | {words} | {rate(sum(s.good for s in known), len(found))}"
        refused = len(found) - len(known)
        if not known:
            told.append(f"{start} | | | | | | | | | | {refused} |")
            continue
        c, m, e = [s.correlation for s in known], [s.median for s in known], [1e3 * s.rms for s in known]
        wrong = [[s.false for s in known], [s.missed for s in known]]
        told.append(
            f"{start} | {np.mean(c):.3f} | {min(c):.3f} | {np.mean(m):.3f} | {min(m):.3f} | "
            f"{np.mean(e):.2f} | {max(e):.2f} | {' | '.join(f'{np.mean(w):.1f} (≤ {max(w)})' for w in wrong)} | "
            f"{np.mean([s.right for s in known]):.0%} | {refused} |"
        )
    if refusals:
        told += ["", "Refused were:", ""]
        told += [f"- {what} (lifts {', '.join(map(str, seeds))})" for what, seeds in refusals.items()]
    return told


def _sort(why: str) -> str:
    """Return a refusal without the trip and the numbers that differ from lift to lift."""
    words = why.split(": ", 1)[-1]
    for sort in ("the filter diverges", "less friction than shoes with play have"):
        if sort in words:
            return sort
    return words
