"""What a model predicts of records that it was not fitted to: the log predictive score, block by block."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from discrepancy.effects.effect import Effect
from discrepancy.evidence.criterion import strength_scale
from discrepancy.evidence.likeliest_forces import settled
from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.linearised_records import linear_records, lost_to_means, noise_floor, record_columns
from discrepancy.evidence.standstill import samples_at_standstill
from discrepancy.innovations.noise_fit import RecordColumns, prior_precision
from discrepancy.innovations.noise_model import NoiseModel
from discrepancy.problem.problem import Problem
from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from discrepancy.stages.fit_stage import with_validation
from discrepancy.stages.held_out_errors import SimulationGain, gain_of_errors
from discrepancy.stages.prior_conflict import needs_prior_conflict
from discrepancy.stages.stage import Stage
from discrepancy.statistics.few_blocks import in_normal_errors

__all__ = [
    "Known",
    "PredictiveGain",
    "changed_share",
    "gain_of_scores",
    "held_out_gain",
    "predictive_gain",
    "scores_of_blocks",
    "shift_over_noise",
    "simulation_gain",
    "stated_score",
    "what_is_known",
    "whitened_blocks",
]

#: Blocks that are left out in turn, at least: records, cut in parts where there are fewer.
BLOCKS = 8
#: Parts of a block whose scores follow one another, each given those before it.  With one, a standard error comes of
#: eight differences, which leaves a quarter of it to chance, and an effect that shows in one block only, as what bends
#: does at a large stroke, seems uncertain whatever its size.  With many, errors that the noise model does not know
#: would reach from one to the next.  Chosen.
PARTS = 8
LEAST_BLOCKS = 4  # of a simulation that is left out
#: Share of a block's own information about a parameter that is kept when the block is left out: what no other block
#: shows, such as a point of a curve where none comes, would else be free.  And what keeps the matrix regular.
KEPT, RIDGE = 1e-2, 1e-9


@dataclass(frozen=True, kw_only=True)
class PredictiveGain:
    """By how much one model predicts blocks left out better than another, nats.

    Parameters
    ----------
    gain : float
        Sum over the blocks.
    standard_error : float
        Of that sum, from its spread over the parts of the blocks.
    blocks : int
    parts : int
        Of all blocks, as many of each.
    stated : float
        By how much it predicts the stated values of parameters better, where these count as well.
    """

    gain: float
    standard_error: float
    blocks: int
    parts: int
    stated: float = 0.0

    def __str__(self) -> str:
        """Return the gain with its standard error."""
        stated = f", of the stated values of parameters {self.stated:+.1f}" if self.stated else ""
        return f"{self.gain:+.1f} ± {self.standard_error:.1f}{stated}"

    def to_dict(self) -> dict[str, float]:
        """Return it as it stands in diagnosis.json."""
        stated = {"stated": self.stated} if self.stated else {}
        return {"gain": self.gain, "standard_error": self.standard_error, "blocks": self.blocks, **stated}

    @property
    def total(self) -> float:
        """Of the blocks and of the stated values together."""
        return self.gain + self.stated

    def exceeds(self, errors: float) -> bool:
        """Tell whether the whole gain is above zero by more than so many standard errors."""
        return self.total > errors * self.standard_error

    def exceeds_normal(self, errors: float) -> bool:
        """Tell the same of so many standard errors of a normal distribution, as improbable with so few parts."""
        return self.exceeds(in_normal_errors(errors, self.parts))


def predictive_gain(one: StageLikelihood, other: StageLikelihood) -> PredictiveGain:
    """Return by how much ``one`` predicts blocks of the identification records left out better than ``other``.

    Where calibration of ``other`` leaves the stated uncertainty of a parameter and that of ``one`` does not, the stated
    values count as well: a model that is calibrated at any price may predict as well as the right one.
    """
    return _with_stated(gain_of_scores(predictive_scores(one), predictive_scores(other)), one, other)


def _with_stated(gain: PredictiveGain, one: StageLikelihood, other: StageLikelihood) -> PredictiveGain:
    """Return a gain with that of the stated values, where these count."""
    if not needs_prior_conflict(one.stage.identify, other.stage.identify):
        return gain
    return replace(gain, stated=stated_score(one) - stated_score(other))


def gain_of_scores(one: np.ndarray, other: np.ndarray) -> PredictiveGain:
    """Return by how much the first scores of the same blocks, (n_blocks, n_parts), are higher than the second.

    Within a block a part is scored given what came before it, so that the differences are those of a martingale if the
    model is right: uncorrelated, however long a disturbance lasts.
    """
    difference = one - other
    n = difference.size
    error = float(np.sqrt(n * np.var(difference, ddof=1))) if n > 1 else np.inf
    return PredictiveGain(gain=float(np.sum(difference)), standard_error=error, blocks=len(difference), parts=n)


def simulation_gain(one: StageLikelihood, other: StageLikelihood, *, fitted_again: bool = True) -> SimulationGain:
    """Return by how much ``one`` simulates blocks of the identification records left out better than ``other``.

    Without ``fitted_again`` as they stand: where a linearisation does not lead from the likeliest parameters to others.
    """
    errors = [simulation_errors(q, fitted_again=fitted_again) for q in (one, other)]
    return gain_of_errors(one.stage.outputs, *errors)


def changed_share(one: Stage, other: Stage) -> np.ndarray:
    """Return the mean square by which two fits of the same records differ, over that of the second's error, (n_c,)."""
    before = np.concatenate([f.residual for f in other.identify.fits])
    after = np.concatenate([f.residual for f in one.identify.fits])
    share: np.ndarray = np.mean((after - before) ** 2, axis=0) / np.maximum(np.mean(before**2, axis=0), 1e-300)
    return share


def shift_over_noise(likelihood: StageLikelihood, effect: Effect) -> float:
    """Return by how many standard deviations of a sensor's noise an effect moves an output, at most.

    That is at the instant and of the output where it is most, with all else as it is: the same measure as that of the
    strength that matters in a scan.
    """
    linearised = likelihood.linearised
    sens, given = linearised.sensitivities(), linearised.preparation
    own = {effect.parameter_name(k): v for k, v in effect.strengths.items()}
    moved = np.array([[own.get(n, 0.0)] for n in sens.names])
    noise = noise_floor(linearised) * np.sqrt(given.average * given.decimate)  # of one recorded sample
    # the scale is the part of the effect that moves some output by its noise
    return float(1.0 / strength_scale([block @ moved for block in sens.blocks], noise)[0])


def simulation_errors(likelihood: StageLikelihood, *, fitted_again: bool = True) -> np.ndarray:
    """Return the sum of squared errors of each block simulated with parameters of the others, (n_blocks, n_c).

    The parameters without a record follow from the normal equations of the fit, in which each output is weighted by
    its scale; each record's own unknowns are fitted to it, as they are when a record is held out.  The white noise that
    the means of several samples have lost counts as it does in the records themselves.  Only samples that are part of
    the likelihood count.  Without ``fitted_again`` the parameters are those of the stage.
    """
    stage, linearised = likelihood.stage, likelihood.undisturbed
    residual, sens = linearised.residual(), linearised.sensitivities()
    used = [~mask for mask in likelihood.left_out]
    moved = [k for k, n in enumerate(sens.names) if n not in likelihood.held]
    weights = np.array([stage.identify.scale[c] for c in residual.channels])
    lost = lost_to_means(linearised)
    # the fit has `average` samples for each of these
    count = float(linearised.preparation.average)
    rows = []
    for mask, whole, slopes, own in zip(used, residual.blocks, sens.blocks, sens.nuisance, strict=True):
        block, slopes, own = whole[mask], slopes[mask][:, :, moved], own[mask] if own is not None else None
        e, f = (block / weights).ravel(), (slopes / weights[:, None]).reshape(block.size, -1)
        if own is not None and own.shape[2]:
            q, _ = np.linalg.qr((own / weights[:, None]).reshape(block.size, -1))
            e, f = e - q @ (q.T @ e), f - q @ (q.T @ f)
        rows.append((np.sqrt(count) * e, np.sqrt(count) * f))
    parts = max(1, -(-LEAST_BLOCKS // len(rows)))
    without_each = _left_out(rows, sens.prior_std[moved], sens.prior_offset[moved])
    errors = []
    for (e, f), without in zip(rows, without_each, strict=True):
        left = e - f @ without.change if fitted_again else e
        left_over = (left.reshape(-1, weights.size) * weights) ** 2 / count
        errors += [np.sum(part, axis=0) + len(part) * lost for part in np.array_split(left_over, parts)]
    return np.array(errors)


def predictive_scores(likelihood: StageLikelihood) -> np.ndarray:
    """Return the log predictive density of every block, given the others, part by part, shape (n_blocks, n_parts).

    Innovations are independent, so blocks of them can be left out one by one.  Around the fit the outputs are linear in
    the parameters: the parameters' distribution without a block follows from the normal equations.  Each record's own
    unknowns are fitted to the record itself, as they are when a record is held out.
    """
    noise = likelihood.noise
    columns, std, offset = record_columns(likelihood.linearised, noise.records, likelihood.held)
    return scores_of_blocks(columns, noise.model, std, offset)


def stated_score(likelihood: StageLikelihood) -> float:
    """Return the log predictive density of the stated values of the parameters, given all records.

    What is stated of a parameter is a measurement of it, which can be left out like a block of a record.  The density
    is that of the values in their stated deviations.
    """
    sens, held, effects = likelihood.linearised.sensitivities(), likelihood.held, likelihood.stage.effects
    own = {e.parameter_name(k) for e in effects for k in (*e.strengths, *e.definition.free_shapes)}
    is_stated = np.array([n not in own for n in sens.names]) & np.isfinite(sens.prior_std)
    moved = np.array([n not in held for n in sens.names])
    rows = np.eye(len(sens.names))[is_stated] / sens.prior_std[is_stated, None]
    stated = sens.prior_offset[is_stated] / sens.prior_std[is_stated], rows[:, moved]
    columns, std, offset = record_columns(likelihood.linearised, likelihood.noise.records, held)
    blocks, _ = whitened_blocks(columns, likelihood.noise.model, 1)
    *_, known = _left_out([*blocks, stated], np.where(is_stated[moved], np.inf, std), offset)
    return _score(*stated, 0.0, known)


def scores_of_blocks(
    columns: Sequence[RecordColumns], model: NoiseModel, std: np.ndarray, offset: np.ndarray
) -> np.ndarray:
    """Return the same of records under a noise model and priors of their shared parameters."""
    blocks, roots = whitened_blocks(columns, model, max(1, -(-BLOCKS // len(columns))))
    given = _left_out(blocks, std, offset)
    return np.array([_in_parts(*block, root, known) for block, root, known in zip(blocks, roots, given, strict=True)])


def held_out_gain(problem: Problem, one: StageLikelihood, other: StageLikelihood) -> PredictiveGain:
    """Return by how much ``one`` predicts the records held out better than ``other``, given the identification records.

    Both are scored on the same samples: those at which no part of the other's machine stands still.  Stated values
    count as in `predictive_gain`.
    """
    masks = samples_at_standstill(_held_out(problem, other))
    gain = gain_of_scores(held_out_scores(problem, one, masks), held_out_scores(problem, other, masks))
    return _with_stated(gain, one, other)


def held_out_scores(problem: Problem, likelihood: StageLikelihood, left_out: Sequence[np.ndarray]) -> np.ndarray:
    """Return the log predictive density of blocks of the records held out, given the identification records.

    Part by part, shape (n_blocks, n_parts).
    """
    model, held = likelihood.noise.model, likelihood.held
    columns, std, offset = record_columns(likelihood.linearised, likelihood.noise.records, held)
    known = what_is_known(whitened_blocks(columns, model, 1)[0], std, offset)
    linearised = _held_out(problem, likelihood)
    records = linear_records(linearised, left_out)
    if likelihood.along_motion:
        linearised, records = settled(linearised, records, model, left_out) or (linearised, records)
    later, _, _ = record_columns(linearised, records, held)
    blocks, roots = whitened_blocks(later, model, max(1, -(-BLOCKS // len(later))))
    return np.array([_in_parts(*block, root, known) for block, root in zip(blocks, roots, strict=True)])


def _held_out(problem: Problem, likelihood: StageLikelihood) -> LinearisedProblem:
    """Return a stage's machine linearised along the records held out, in the parameters that were calibrated."""
    fits = with_validation(problem, likelihood.stage).fits("validate")
    quiet = tuple(replace(f, experiment=f.experiment.without_input_noise()) for f in fits)
    return likelihood.undisturbed.with_calibration(replace(likelihood.stage.identify, fits=quiet))


def whitened_blocks(
    columns: Sequence[RecordColumns], model: NoiseModel, parts: int
) -> tuple[list[tuple[np.ndarray, np.ndarray]], list[np.ndarray]]:
    """Return residual and shared columns of each part of each record, whitened, and the log root of the whitening.

    The latter for each row of the part.
    """
    blocks, roots = [], []
    for record in columns:
        white = record.whitened(model)
        n_c = record.residual.shape[1]
        for rows in np.array_split(np.arange(len(record.residual)), parts):
            part = slice(int(rows[0]) * n_c, (int(rows[-1]) + 1) * n_c)
            blocks.append((white.residual[part], white.shared[part]))
            roots.append(white.log_root[rows])
    return blocks, roots


def _in_parts(residual: np.ndarray, shared: np.ndarray, log_root: np.ndarray, known: Known) -> np.ndarray:
    """Return the log predictive density of the parts of a block, whitened, each given those before it, (n_parts,)."""
    values = np.arange(residual.size).reshape(log_root.size, -1)  # of all outputs, row by row
    scores = []
    for taken, roots in zip(np.array_split(values, PARTS), np.array_split(log_root, PARTS), strict=True):
        part = residual[taken.ravel()], shared[taken.ravel()]
        scores.append(_score(*part, float(np.sum(roots)), known))
        known = known.after(*part)
    return np.array(scores)


def _score(residual: np.ndarray, shared: np.ndarray, root: float, known: Known) -> float:
    """Return the log predictive density of a block, whitened, given what other blocks say of the parameters."""
    r, columns = residual - shared @ known.change, shared / known.size
    # the covariance I + F A⁻¹ Fᵀ of a block, by the small matrix
    inner = known.normal + columns.T @ columns
    along = columns.T @ r
    quadratic = float(r @ r - along @ np.linalg.solve(inner, along))
    log_det = float(np.linalg.slogdet(inner)[1] - np.linalg.slogdet(known.normal)[1])
    return root - 0.5 * (quadratic + log_det)


@dataclass(frozen=True, eq=False, kw_only=True)
class Known:
    """What some blocks say of the parameters.

    Parameters
    ----------
    change : ndarray, shape (k,)
        Of the parameters, from the linearisation's values.
    normal : ndarray, shape (k, k)
        Normal matrix of the parameters times ``size``.
    size : ndarray, shape (k,)
    """

    change: np.ndarray
    normal: np.ndarray
    size: np.ndarray

    def after(self, residual: np.ndarray, shared: np.ndarray) -> Known:
        """Return what is known after a further block, its residual and columns in standard deviations."""
        columns = shared / self.size
        normal = self.normal + columns.T @ columns
        change = np.linalg.solve(normal, columns.T @ (residual - shared @ self.change)) / self.size
        return replace(self, change=self.change + change, normal=normal)


def _normal_equations(
    blocks: Sequence[tuple[np.ndarray, np.ndarray]], prior_std: np.ndarray, prior_offset: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return matrix and right-hand side of the parameters' normal equations, and the scale of each parameter."""
    precision = prior_precision(prior_std)
    whole = np.diag(precision) + sum(f.T @ f for _, f in blocks)
    right = precision * prior_offset + sum(f.T @ e for e, f in blocks)
    return whole, right, np.sqrt(np.maximum(np.diag(whole), 1e-300))


def what_is_known(
    blocks: Sequence[tuple[np.ndarray, np.ndarray]], prior_std: np.ndarray, prior_offset: np.ndarray
) -> Known:
    """Return what all blocks, each residual and columns in standard deviations, say of the parameters."""
    whole, right, size = _normal_equations(blocks, prior_std, prior_offset)
    normal = whole / np.outer(size, size) + RIDGE * np.eye(size.size)
    return Known(change=np.linalg.solve(normal, right / size) / size, normal=normal, size=size)


def _left_out(
    blocks: Sequence[tuple[np.ndarray, np.ndarray]], prior_std: np.ndarray, prior_offset: np.ndarray
) -> Iterator[Known]:
    """Yield for each block, its residual and columns in standard deviations, what the others say of the parameters."""
    whole, right, size = _normal_equations(blocks, prior_std, prior_offset)
    for e, f in blocks:
        rest, left = whole - (1.0 - KEPT) * f.T @ f, right - (1.0 - KEPT) * f.T @ e
        normal = rest / np.outer(size, size) + RIDGE * np.eye(size.size)
        yield Known(change=np.linalg.solve(normal, left / size) / size, normal=normal, size=size)
