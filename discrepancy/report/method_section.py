"""Sections of the report on its records and its method."""

from __future__ import annotations

from importlib import metadata
from typing import TYPE_CHECKING, Any

from discrepancy.questions.compare import PARTS
from discrepancy.report.figures import PART_WORDS
from discrepancy.report.wording import share_words
from multibody.base.quantity_text import count_text
from multibody.fmi.component import sensitivity_sources

if TYPE_CHECKING:
    from discrepancy.conclusion.conclusion import Conclusion

__all__ = ["how", "records"]

Entry = dict[str, Any]

_MODES = {
    "simulation": "the model is simulated with the recorded inputs, and its outputs are compared with those recorded",
    "prediction": "the model is restarted from the measurement in every window, and compared",
    "inverse": "the recorded motion is prescribed, and the force that it needs is compared with the recorded one",
}


def records(conclusion: Conclusion) -> list[Entry]:
    """Return every record with its preparation and its own unknowns."""
    entries = []
    for part in PARTS:
        for fit in conclusion.final.fits(part):
            e = fit.experiment
            done = [*e.record.log, *e.preparation.describe(float(e.record.rate))]
            added = {c.name: c.added for c in e.clocks}
            own = [
                f"{name}: {added[name] + value:.4g} s are added to its time, fitted for this record"
                if name in added
                else f"{name} fitted for this record: {value:.4g}"
                for name, value in fit.own.items()
            ]
            entries.append(
                {
                    "name": e.name,
                    "part": PART_WORDS[part],
                    "file": str(e.record.path.name),
                    "length": (f"{e.record.duration:.4g} s at {e.record.rate:.4g} Hz, {len(e.time)} samples compared"),
                    "log": [line for line in (*done, *own) if not line.startswith("warning: ")],
                    "warnings": list(e.record.warnings),
                }
            )
    return entries


def how(conclusion: Conclusion) -> list[tuple[str, str]]:
    """Return the method of the study, as pairs of a heading and a sentence."""
    scan = conclusion.baseline.scan
    lines = [
        (
            "Residual",
            conclusion.residual_mode
            + ": "
            + _MODES.get(conclusion.residual_mode, "")
            + (f", because {conclusion.residual_reason}" if conclusion.residual_reason else ""),
        ),
        (
            "Fit",
            "least squares over full simulations, with the priors of the parameters; intervals account for the "
            "correlation of the residual",
        ),
    ]
    lines += [
        (f"Sensitivities of '{name}'", source)
        for name, source in sensitivity_sources(conclusion.final.model.components).items()
    ]
    if scan is not None:
        lines.append(
            (
                "Tested",
                f"{count_text(len(scan.rows) + len(scan.refused), 'effect')}, one for each kind at each place where "
                "it can act; everything that a recalibration could explain is projected out first",
            )
        )
    if conclusion.verdict:
        lines.append(
            (
                "Significance level",
                f"{share_words(conclusion.level)}: the probability of naming an effect in a study of a correct model, "
                "over all effects together; the null distribution comes from resampling blocks of the residual",
            )
        )
    versions = []
    for package in ("vtsdt", "numpy", "scipy", "numba"):
        try:
            versions.append(f"{package} {metadata.version(package)}")
        except metadata.PackageNotFoundError:
            continue
    lines += [("Random seed", str(conclusion.seed)), ("Versions", ", ".join(versions))]
    if conclusion.paths:
        lines.append(("Files", ", ".join(conclusion.paths)))
    return lines
