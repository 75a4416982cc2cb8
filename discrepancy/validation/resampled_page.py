"""The results of resampled residuals as a section of a page."""

from __future__ import annotations

from collections.abc import Sequence

from discrepancy.validation.resampled import REPEATS, SCHEMES, SHIFT, Resampled
from discrepancy.validation.trials import wilson

__all__ = ["resampled_page"]


def resampled_page(
    trials: Sequence[Resampled],
    study: str,
    effects: Sequence[str],
    level: float,
    date: str,
    again: tuple[float, float] = (0.0, 0.0),
    caution: str = "",
) -> str:
    """Return the result as a section (Markdown); ``again`` is what `repeats` says of the best model's records.

    ``caution`` is `ResamplingData.caution`.
    """
    untied = [t for t in trials if t.scheme != SHIFT or again[1] < REPEATS]

    def row(what: str, part: Sequence[Resampled], hits: int) -> str:
        low, high = wilson(hits, len(part))
        return f"| {what} | {hits} | {len(part)} | {hits / max(len(part), 1):.1%} | {low:.1%} to {high:.1%} |"

    lines = [
        f"Made by `vtsdt validate discrepancy resampled --study {study}` on {date}, numbers "
        f"{min(t.number for t in trials)} to {max(t.number for t in trials)}. The best model has "
        f"{', '.join(effects) or 'no effect added'}; level {level:g}.",
        "",
        "| | alarms | trials | rate | 95 % interval |",
        "|---|---|---|---|---|",
        row("any alarm", untied, sum(t.alarm for t in untied)),
    ]
    for scheme in SCHEMES:
        part = [t for t in trials if t.scheme == scheme]
        if part:
            lines.append(row(scheme, part, sum(t.alarm for t in part)))
    for what in ("plain", "whitened", "pairs", "curves"):
        lines.append(row(f"of the {what} scan", untied, sum(bool(getattr(t, what)) for t in untied)))
    if len(untied) < len(trials):
        lines += [
            "",
            f"Circular shifts of a whole record do not count: its inputs repeat after {again[0]:.3g} s "
            f"(autocorrelation {again[1]:.2f}), so that a shifted residual still follows the motion. What is found "
            "there is no false alarm: the best model leaves something that follows the motion.",
        ]
    lines += ["", caution] if caution else []
    lines += ["", "Alarms:", ""]
    lines += [
        f"- {t.number}, {t.scheme}: {', '.join(filter(None, (t.plain, t.whitened, t.pairs, t.curves)))} (p = {t.p:.2g})"
        for t in trials
        if t.alarm
    ]
    return "\n".join(lines)
