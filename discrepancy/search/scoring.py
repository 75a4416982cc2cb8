"""The scores of all candidates on a stage's residual, without whitening and with it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, TypedDict

from discrepancy.effects.catalogue import Entry, catalogue
from discrepancy.sensitivities.candidates import candidate_sensitivities
from discrepancy.stages.stage import Stage
from discrepancy.statistics.blocks import Candidate, Residual, Sensitivities
from discrepancy.statistics.thresholds import LEVEL_SHARES
from multibody.base.quantity_text import count_text

if TYPE_CHECKING:
    from discrepancy.statistics.scan_result import ScanResult

__all__ = ["ScanSettings", "catalogue_of", "score_candidates"]


class ScanSettings(TypedDict):
    """How candidates are scored: patterns of the catalogue, family-wise level, seed and progress."""

    include: Sequence[str]
    exclude: Sequence[str]
    level: float
    seed: int
    progress: Callable[[str], None]


def catalogue_of(stage: Stage, include: Sequence[str] = ("*",), exclude: Sequence[str] = ()) -> list[Entry]:
    """Return the entries of the catalogue for a stage's model and records.

    Parameters
    ----------
    stage : Stage
    include, exclude : sequence of str
        Patterns of the catalogue.
    """
    experiment = stage.identify.fits[0].experiment
    return catalogue(stage.system, experiment.outputs, experiment.inputs, include=include, exclude=exclude)


def score_candidates(
    stage: Stage,
    *,
    include: Sequence[str],
    exclude: Sequence[str],
    level: float,
    seed: int,
    progress: Callable[[str], None],
) -> tuple[list[ScanResult], list[Candidate], list[tuple[Entry, str]]]:
    """Return the scans of a stage's residual, the candidates scored, and those that the records cannot answer for.

    Parameters
    ----------
    stage : Stage
    include, exclude : sequence of str
        Patterns of the catalogue.
    level : float
        Family-wise significance level of the step, of which each scan has its share.
    seed : int
    progress : callable
    """
    problem = stage.weighted_problem()
    entries = catalogue_of(stage, include, exclude)
    candidates, refused = candidate_sensitivities(problem, entries, progress, stage.effects, curves=not stage.effects)
    residual, sensitivities = problem.residual(), problem.sensitivities()
    progress(f"scores of {count_text(len(candidates), 'candidate')}")
    return _scans(residual, sensitivities, candidates, level, seed, stage.noise), candidates, refused


def _scans(
    residual: Residual,
    sensitivities: Sensitivities,
    candidates: Sequence[Candidate],
    level: float,
    seed: int,
    noise: Mapping[str, float],
) -> list[ScanResult]:
    """Scan without whitening, which tolerates effects of inexact shape; then with whitening, which finds small ones.

    Each scan gets its share of the level, as the free curves and the omnibus test do, so that all together keep it.
    Where the residual is correlated over so long that it has few independent pieces, no null distribution exists for
    the scan without whitening, as with a disturbance that adds up along the record: only the whitened scan is made.
    """
    from discrepancy.statistics.scan import scan
    from discrepancy.statistics.verdicts import Verdict
    from discrepancy.statistics.whitened import scaled_by_rms

    plain = scaled_by_rms(residual, sensitivities, candidates)

    def scanned(whiten: bool) -> ScanResult:
        return scan(
            residual,
            sensitivities,
            candidates,
            level=level / LEVEL_SHARES,
            seed=seed,
            noise_floor=[noise[c] for c in residual.channels],
            whiten=whiten,
            plain=plain,
        )

    first = scanned(whiten=False)
    if first.null.pieces.too_few:
        return [scanned(whiten=True)]
    if any(r.verdict is Verdict.MISSING for r in first.rows):
        return [first]
    return [first, scanned(whiten=True)]
