"""The page of the study of the alignment sensor: tables, rates with intervals, and a reason for every miss."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from vtsdt.alignment.score import HEIGHTS, MAX_RMS, MAX_WRONG, MIN_CORRELATION, Score
from vtsdt.alignment.study_lines import FIRST_UNSEEN_SEED, TEN_TRIPS, TWENTY_TRIPS, UNDISTURBED, LiftScores, lines
from vtsdt.alignment.virtual_lifts import RAIL_SHIFT, SCALING_TRIPS, UNDISTURBED_TRIPS

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


def page(lifts: Sequence[LiftScores], command: str) -> str:
    """Return the scores as a page of the documentation.

    Parameters
    ----------
    lifts : sequence of LiftScores
    command : str
        Which made them.
    """
    text = ["# Guide alignment on the virtual lift", "", *_introduction(lifts, command), "", *_by_lift(lifts), ""]
    text += [*_rates(lifts), "", "## Misses and their reasons", "", *_misses(lifts), "", *_by_line(lifts)]
    return "\n".join(text) + "\n"


def _introduction(lifts: Sequence[LiftScores], command: str) -> list[str]:
    seen = [str(c.seed) for c in lifts if c.seed < FIRST_UNSEEN_SEED]
    return [
        f"Written by `{command}`. The data are synthetic; the estimator never sees the truth. Lifts with the seeds "
        f"{', '.join(str(c.seed) for c in lifts)}, ten trips from end to end each, recorded at 1 kHz with everything "
        "that the cabin model lacks: both rails bent in both directions, a disturbing force of 1 N, true mass, "
        "friction and contact stiffness that differ from the nominal ones, sensor noise and offsets. "
        + (
            f"The lifts {', '.join(seen)} were used while the method was developed."
            if seen
            else "No part of the method was chosen or adjusted on these lifts."
        ),
        "",
        "The true equivalent deviation is that of a single rail that presses on the shoes as hard as all rails of the "
        "lift do: the normal forces of the true cabin at rest at each height, divided by its contact stiffness. "
        "Friction shows this quantity and no other. As long as all shoes press, it is the sum of both rails' "
        "deviations in x, averaged over the heights of the lower and upper shoes. Where one level of shoes is loose it "
        "is larger, because a normal force cannot be negative and a cabin whose centre of mass is not below its ropes "
        "leans on the rail all the same. No sensor of the trips could separate the two. Correlations with the sum in x "
        f"alone have a column of their own. Heights of the cabin's floor from {HEIGHTS[0]:g} to {HEIGHTS[1]:g} m are "
        "evaluated.",
        "",
        f"The paper's scaling: the right rail was moved by {1e3 * RAIL_SHIFT:g} mm as a whole, {SCALING_TRIPS} trips "
        "were recorded before and after, and the friction coefficient of the filter was scaled until δ grew by as "
        "much. None of these trips is among those that are evaluated, and each trip has its own disturbing force.",
    ]


def _by_lift(lifts: Sequence[LiftScores]) -> list[str]:
    rows = [
        "## Ten trips, lift by lift",
        "",
        "| lift | true friction μ K over nominal | factor from the scaling | true mass over nominal | spread of the "
        "true deviation over height [mm] | correlation | of the median | with x alone | expected from the spread of "
        f"the trips | {UNDISTURBED_TRIPS} trips without the disturbing force | 20 trips | RMS error [mm] | mean error "
        "[mm] | false | missed | heights classified correctly | truth within the 95 % interval of the estimate |",
        "|---|" + "---:|" * 16,
    ]
    for lift in lifts:
        cells = [f"{lift.friction:.3f}", f"{lift.factor:.3f}", f"{lift.mass:.4f}", f"{1e3 * lift.spread:.2f}"]
        ten = lift.score(TEN_TRIPS)
        if ten is None:
            rows.append(f"| {lift.seed} | {' | '.join(cells)} | refused {'| ' * 11}|")
            continue
        others = [lift.score(what) for what in (UNDISTURBED, TWENTY_TRIPS)]
        cells += [
            f"{ten.correlation:.3f}",
            f"{ten.median_correlation:.3f}",
            f"{_or_nan(ten.in_plane_correlation):.3f}",
            f"{_or_nan(ten.expected_correlation):.3f}",
            *("" if s is None else f"{s.correlation:.3f}" for s in others),
            f"{1e3 * ten.rms:.2f}",
            f"{1e3 * ten.mean_error:+.2f}",
            f"{ten.false}",
            f"{ten.missed}",
            f"{ten.agreement:.0%}",
            f"{_or_nan(ten.coverage):.0%}",
        ]
        rows.append(f"| {lift.seed} | {' | '.join(cells)} |")
    return rows


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else value


def _rates(lifts: Sequence[LiftScores]) -> list[str]:
    """Return how often each requirement is reached, with intervals."""
    known = [s for s in (lift.score(TEN_TRIPS) for lift in lifts) if s is not None]
    required: tuple[tuple[str, Callable[[Score], bool]], ...] = (
        (f"correlation of the estimate at least {MIN_CORRELATION:g}", lambda s: s.correlation >= MIN_CORRELATION),
        (
            f"correlation of the median over trips at least {MIN_CORRELATION:g}",
            lambda s: s.median_correlation >= MIN_CORRELATION,
        ),
        (f"RMS error at most {1e3 * MAX_RMS:g} mm", lambda s: s.rms <= MAX_RMS),
        ("at most one false and one missed section", lambda s: s.false <= MAX_WRONG and s.missed <= MAX_WRONG),
        ("no false and no missed section", lambda s: s.false + s.missed == 0),
        ("estimate: correlation, error and sections together", lambda s: s.passed),
    )
    text = ["| requirement on ten trips | lifts (95 % interval of Clopper and Pearson) |", "|---|---|"]
    text += [f"| {words} | {rate(sum(map(test, known)), len(lifts))} |" for words, test in required]
    error = np.array([lift.factor / lift.friction - 1.0 for lift in lifts])
    error = 100 * error[np.isfinite(error)]
    if error.size:
        text += [
            "",
            f"After the scaling by the moved rail the friction is wrong by {np.sqrt(np.mean(error**2)):.0f} % in the "
            f"root mean square and by {np.abs(error).max():.0f} % at worst, because its trips have disturbing forces, "
            "too. An error of the friction shifts the whole estimate, and with it the edges of sections, but does not "
            "change the correlation.",
        ]
    coverage = [s.coverage for s in known if s.coverage is not None]
    if coverage:
        text += [
            "",
            f"Over all lifts the truth is within 1.96 standard deviations of the estimate at {np.mean(coverage):.0%} "
            "of the heights. The standard deviation comes from the spread of the trips and does not include errors "
            "that all trips share, such as a wrong scale of the friction.",
        ]
    return text


def _misses(lifts: Sequence[LiftScores]) -> list[str]:
    """Return every lift that falls short, and every wrong section, with the numbers."""
    text = []
    for lift in lifts:
        ten = lift.score(TEN_TRIPS)
        if ten is None:
            refused = next((v for k, v in lift.scores.items() if k.endswith(TEN_TRIPS)), "not run")
            text.append(f"- Lift {lift.seed}: {refused}")
            continue
        parts = [_shortfall(lift, ten)] if ten.shortfalls() else []
        if ten.median_correlation < MIN_CORRELATION:
            parts.append(
                f"the median over the trips has a correlation of {ten.median_correlation:.3f}, the median over their "
                f"pairs {ten.correlation:.3f}: the plain median keeps half as much variance again of the errors that "
                "differ between trips"
            )
        parts += [wrong.sentence() for wrong in ten.wrong]
        if ten.wrong and np.isfinite(lift.factor):
            parts.append(
                f"The mean error of this estimate is {1e3 * ten.mean_error:+.2f} mm; the scaling left the friction "
                f"wrong by {100 * (lift.factor / lift.friction - 1.0):+.0f} %"
            )
        if parts:
            text.append(f"- Lift {lift.seed}: " + ". ".join(parts) + ".")
    return text or ["None."]


def _shortfall(lift: LiftScores, ten: Score) -> str:
    """Return what a lift does not reach, and what it reaches without the disturbing force and with more trips."""
    text = (
        f"falls short with {', '.join(ten.shortfalls())}; its deviation varies by {1e3 * lift.spread:.2f} mm over "
        "height"
    )
    for what, words in (
        (UNDISTURBED, f"{UNDISTURBED_TRIPS} trips without the disturbing force"),
        (TWENTY_TRIPS, "20 trips"),
    ):
        other = lift.score(what)
        if other is not None:
            reached = "reach it" if other.passed else f"fall short as well ({', '.join(other.shortfalls())})"
            text += f"; {words} {reached}: correlation {other.correlation:.3f}, error {1e3 * other.rms:.2f} mm"
    return text


def _by_line(lifts: Sequence[LiftScores]) -> list[str]:
    text = [
        "## How it degrades",
        "",
        "Correlation and error of the estimate: mean over the lifts, and the worst of them. False and missed: sections "
        "above 2.3 mm, mean over the lifts and the largest number. Errors are added to those that the recordings have. "
        f'"20 trips" and "{UNDISTURBED}": the lifts that take all lines, and those that fall short. "refused": lifts '
        'whose trips the command refuses. "reached": lifts that reach the required correlation, error and sections, '
        "with the 95 % interval. Each tuning has its own scaling.",
        "",
        "| changed | | reached | correlation | worst | of the median | worst | RMS error [mm] | worst | false | missed "
        "| heights classified correctly | refused |",
        "|---|---|---|---:|---:|---:|---:|---:|---:|---|---|---:|---:|",
    ]
    refusals: dict[str, list[int]] = {}
    rows = [(line, line.what, lifts) for line in lines()]
    full = [lift for lift in lifts if all(line.name in lift.scores for line in lines())]
    if full and len(full) < len(lifts):
        rows.insert(1, (rows[0][0], f"the same, lifts {', '.join(str(c.seed) for c in full)} alone", full))
    for line, words, taken in rows:
        results = [(lift.seed, lift.scores[line.name]) for lift in taken if line.name in lift.scores]
        if not results:
            continue
        known = [s for _, s in results if isinstance(s, Score)]
        for seed, reason in results:
            if isinstance(reason, str):
                refusals.setdefault(f"{line.group}, {line.what}: {_kind_of_refusal(reason)}", []).append(seed)
        start = f"| {line.group} | {words} | {rate(sum(s.passed for s in known), len(results))}"
        refused = len(results) - len(known)
        if not known:
            text.append(f"{start} | | | | | | | | | | {refused} |")
            continue
        c, m = [s.correlation for s in known], [s.median_correlation for s in known]
        e = [1e3 * s.rms for s in known]
        wrong = [[s.false for s in known], [s.missed for s in known]]
        text.append(
            f"{start} | {np.mean(c):.3f} | {min(c):.3f} | {np.mean(m):.3f} | {min(m):.3f} | "
            f"{np.mean(e):.2f} | {max(e):.2f} | {' | '.join(f'{np.mean(w):.1f} (≤ {max(w)})' for w in wrong)} | "
            f"{np.mean([s.agreement for s in known]):.0%} | {refused} |"
        )
    if refused_lines := [f"- {what} (lifts {', '.join(map(str, seeds))})" for what, seeds in refusals.items()]:
        text += ["", "Refused:", "", *refused_lines]
    return text


def _kind_of_refusal(reason: str) -> str:
    """Return a refusal without the trip and the numbers that differ between lifts."""
    words = reason.split(": ", 1)[-1]
    for kind in ("the filter diverges", "less friction than shoes with play have"):
        if kind in words:
            return kind
    return words
