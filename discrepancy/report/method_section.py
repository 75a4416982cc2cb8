"""What the report says about its records and about how the study was done."""

from __future__ import annotations

from importlib import metadata
from typing import TYPE_CHECKING, Any

from discrepancy.questions.compare import PARTS
from discrepancy.report.figures import PART_WORDS
from discrepancy.report.wording import share_words

if TYPE_CHECKING:
    from discrepancy.conclusion.conclusion import Conclusion

__all__ = ["how", "records"]

Entry = dict[str, Any]

_MODES = {
    "simulation": "the model was run from the recorded inputs, its outputs laid beside the recorded ones",
    "prediction error": "the model was restarted from the measurement again and again, and compared",
    "inverse": "the recorded motion was given to the model, the force it takes laid beside the recorded one",
}


def records(conclusion: Conclusion) -> list[Entry]:
    """Return every record with what was assumed of it and done to it."""
    found = []
    for part in PARTS:
        for fit in conclusion.final.fits(part):
            e = fit.experiment
            done = [*e.record.log, *e.preparation.describe(float(e.record.rate))]
            own = [f"{name} fitted for this record: {value:.4g}" for name, value in fit.own.items()]
            found.append(
                {
                    "name": e.name,
                    "part": PART_WORDS[part],
                    "file": str(e.record.path.name),
                    "length": (
                        f"{e.record.duration:.4g} s at {e.record.rate:.4g} Hz, {len(e.time)} samples compared"
                    ),
                    "log": [line for line in (*done, *own) if not line.startswith("warning: ")],
                    "warnings": list(e.record.warnings),
                }
            )
    return found


def how(conclusion: Conclusion) -> list[tuple[str, str]]:
    """Return how the study was done, as pairs of a heading and a sentence."""
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
            "Fitted by",
            "least squares over full runs of the model, with what was believed of the parameters before; "
            "intervals hold for errors that are related from sample to sample",
        ),
    ]
    if scan is not None:
        lines.append(
            (
                "Looked for",
                f"{len(scan.rows) + len(scan.refused)} effects, one for each kind at each place where it "
                "can act; what recalibration could imitate is taken out first",
            )
        )
    if conclusion.verdict:
        lines.append(
            (
                "Believed only if",
                f"luck would give as much in fewer than {share_words(conclusion.level)} of studies "
                "of a good model, over all effects together; luck is measured by shuffling stretches of "
                "the error",
            )
        )
    versions = []
    for package in ("vtsdt", "numpy", "scipy", "numba"):
        try:
            versions.append(f"{package} {metadata.version(package)}")
        except metadata.PackageNotFoundError:
            continue
    lines += [("Seed of random numbers", str(conclusion.seed)), ("Versions", ", ".join(versions))]
    if conclusion.paths:
        lines.append(("Files", ", ".join(conclusion.paths)))
    return lines
