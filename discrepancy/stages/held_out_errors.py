"""By how much one model simulates records that were left out better than another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from discrepancy.stages.stage import Stage
from discrepancy.statistics.few_blocks import in_normal_errors

__all__ = ["SimulationGain", "gain_of_errors", "held_out_gain_of_errors", "simulated_worse"]


@dataclass(frozen=True, kw_only=True)
class SimulationGain:
    """By how much one model simulates records left out better than another, output by output.

    Parameters
    ----------
    outputs : tuple of str
    share : ndarray, shape (n_c,)
        Of the mean square error of the other model that is gone; negative where the error has grown.
    standard_error : ndarray, shape (n_c,)
        Of that share, from its spread over the blocks.
    blocks : int
    """

    outputs: tuple[str, ...]
    share: np.ndarray
    standard_error: np.ndarray
    blocks: int

    def __str__(self) -> str:
        parts = zip(self.outputs, self.share, self.standard_error, strict=True)
        return ", ".join(f"{n} {100 * s:+.2g} ± {100 * e:.2g} %" for n, s, e in parts)

    def in_normal_errors(self, errors: float) -> float:
        """Return the multiple of the standard error that is as improbable as ``errors`` of a normal distribution."""
        return in_normal_errors(errors, self.blocks)

    def helps(self, least: float, errors: float) -> bool:
        """Tell whether some output is simulated better by at least so large a share and so many standard errors."""
        return bool(self.better(least, errors))

    def better(self, least: float, errors: float) -> tuple[str, ...]:
        """Return the outputs that are simulated better by at least so large a share and so many standard errors."""
        found = (self.share >= least) & (self.share > errors * self.standard_error)
        return tuple(n for n, is_better in zip(self.outputs, found, strict=True) if is_better)

    def worse(self, least: float, errors: float) -> tuple[str, ...]:
        """Return the outputs that are simulated worse by at least so large a share and so many standard errors.

        A single block shows no scatter: `in_normal_errors` is infinite then, and no output counts as worse.
        """
        if np.isinf(errors):
            return ()
        found = (-self.share >= least) & (-self.share > errors * self.standard_error)
        return tuple(n for n, is_worse in zip(self.outputs, found, strict=True) if is_worse)

    def rules_out(self, least: float, errors: float) -> np.ndarray:
        """Tell of each output whether an improvement by so large a share is out of so many standard errors' reach."""
        return self.share + errors * self.standard_error < least

    def harms(self, least: float, errors: float) -> bool:
        """Tell whether some output is simulated worse by at least so large a share and so many standard errors."""
        return bool(self.worse(least, errors))


def gain_of_errors(outputs: tuple[str, ...], one: np.ndarray, other: np.ndarray) -> SimulationGain:
    """Return by how much the first squared errors, (n_blocks, n_c), are smaller than the second.

    Blocks count alike, whatever their size: the mean over the blocks of the logarithm of the ratio.
    """
    ratios = np.log(np.maximum(one, 1e-300) / np.maximum(other, 1e-300))
    mean, n = np.mean(ratios, axis=0), len(ratios)
    error = np.std(ratios, axis=0, ddof=1) / np.sqrt(n) if n > 1 else np.zeros(mean.size)
    return SimulationGain(outputs=outputs, share=-np.expm1(mean), standard_error=np.exp(mean) * error, blocks=n)


def held_out_gain_of_errors(one: Stage, other: Stage) -> SimulationGain:
    """Return by how much one stage simulates the records held out better than another; both have been validated."""
    return gain_of_errors(one.outputs, _squared_errors(one), _squared_errors(other))


def simulated_worse(one: Stage, other: Stage, least: float) -> tuple[str, ...]:
    """Return the outputs of which one stage has a mean square error on the records held out that is larger by a share.

    All records together, as a report shows the error, and however much it differs between them: two or three records
    cannot tell a rise from chance, and nobody adds an effect to a model that then shows a larger error.
    """
    had = other.rmse("validate")
    return tuple(n for n, error in one.rmse("validate").items() if error**2 > (1.0 + least) * had[n] ** 2)


def _squared_errors(stage: Stage) -> np.ndarray:
    """Return the sum of squared errors of each record held out, (n_records, n_c)."""
    return np.array([np.sum(f.residual**2, axis=0) for f in stage.fits("validate")])
