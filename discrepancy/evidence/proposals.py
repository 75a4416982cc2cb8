"""What a model may be extended by: every candidate scored on its innovations, ordered by linear evidence."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from discrepancy.effects.catalogue import Entry, catalogue
from discrepancy.effects.effect import Effect
from discrepancy.effects.from_scan_row import effect_of, simpler_in
from discrepancy.evidence.criterion import log_prior_of_strengths, strength_scale
from discrepancy.evidence.fitted_noise import REGAINED, fitted_noise, log_price
from discrepancy.evidence.likelihood import StageLikelihood
from discrepancy.evidence.likeness import ParameterLikeness, parameter_likeness
from discrepancy.evidence.linearised_records import noise_floor, record_columns, with_columns
from discrepancy.evidence.policy import POLICY
from discrepancy.innovations.noise_fit import restricted_log_likelihood
from discrepancy.innovations.noise_model import NoiseModel
from discrepancy.sensitivities.candidates import candidate_sensitivities
from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from discrepancy.stages.stage import Stage
from discrepancy.statistics.blocks import Candidate, Sensitivities, Weighting
from discrepancy.statistics.scan import scan
from discrepancy.statistics.scan_result import ScanResult
from discrepancy.statistics.thresholds import LEVEL_SHARES
from discrepancy.statistics.ties import canonical_correlation
from discrepancy.statistics.whitened import WhitenedProblem, whiten_all
from discrepancy.statistics.whitening import identity
from multibody.assembly.places import Place
from multibody.base.quantity_text import count_text

__all__ = [
    "Proposal",
    "Proposals",
    "ScoredCandidate",
    "entries_of",
    "moving_together",
    "parameter_of_same_law",
    "propose",
    "proposed_effects",
]


#: Kinds of which a machine may have several at one place, told apart by their shape: waves of other orders, tight spots
#: elsewhere.  A second law of any other kind at the same place is the first with another strength.
REPEATABLE = frozenset({"angle_harmonic", "local_bump"})
#: Share of its speed by which a place may leave the proportion to another that a rigid gear keeps: rounding.
RIGID = 1e-9
#: Candidates that explain what is taken for random, which are fitted in full, the noise anew: each costs seconds.
REFITTED = 4
#: Forces that do not change.  At rest a force below the limit of dry friction changes nothing in the linearised
#: problem, and yet it decides where and when a part comes to rest and moves on.
STEADY = frozenset({"constant_force", "input_offset"})
#: What is steady of a random force, or of a random error of a recorded input or an output.
MEANS = ("constant_force", "input_offset", "sensor_offset")
#: Memory of a latent process, over the longest record, from which its mean cannot be told from it: ten memories tell
#: the mean to a third of the process's standard deviation.
LONG_MEMORY = 0.1


def entries_of(stage: Stage, include: Sequence[str] = ("*",), exclude: Sequence[str] = ()) -> list[Entry]:
    """Return the catalogue of a stage's machine."""
    experiment = stage.identify.fits[0].experiment
    signals = experiment.outputs, experiment.inputs
    return catalogue(stage.system, *signals, include=include, exclude=exclude, every_law=True)


@dataclass(frozen=True, eq=False, kw_only=True)
class ScoredCandidate:
    """One candidate at the shape at which its linear evidence is largest.

    Parameters
    ----------
    candidate : Candidate
    shape : dict of str to float
    expected_strength : ndarray, shape (k,)
        In the candidate's unit.
    gain : float
        By which the log evidence rises with it in the linearised problem, without the prior odds of its name; minus
        infinity where it would act the other way.
    direction : ndarray, shape (n_rows, k)
        Orthonormal: what it changes that calibration cannot.
    noise : NoiseModel or None
        Under which it was scored.
    other_law : ScoredCandidate or None
        The same kind at the same place with another law, if it has one: it may do better once it is fitted.
    """

    candidate: Candidate
    shape: dict[str, float]
    expected_strength: np.ndarray
    gain: float
    direction: np.ndarray
    noise: NoiseModel | None = None
    other_law: ScoredCandidate | None = None

    @property
    def name(self) -> str:
        """``kind@where``."""
        return self.candidate.name

    @property
    def kind(self) -> str:
        """Of the candidate."""
        return self.candidate.kind

    @property
    def where(self) -> str:
        """Of the candidate."""
        return self.candidate.where

    @property
    def at_one_shape(self) -> Candidate:
        """The candidate with no shape but this one."""
        k = self.candidate.shapes.index(self.shape)
        one = slice(k, k + 1)
        return replace(
            self.candidate, shapes=self.candidate.shapes[one], sensitivities=self.candidate.sensitivities[one]
        )

    @property
    def entry(self) -> Entry:
        """Of the catalogue."""
        entry: Entry = self.candidate.info["entry"]
        return entry


@dataclass(frozen=True, eq=False, kw_only=True)
class Proposal:
    """Effects that may be added at once, and those that they replace.

    Parameters
    ----------
    move : str
        ``"add"``, ``"add a pair"``, ``"add a curve"``, ``"exchange"`` or ``"drop"``.
    effects : tuple of Effect
        Of the model that is proposed.
    starts : tuple of tuple of Effect
        Further sets of values from which the fit may begin.
    laws : tuple of tuple of Effect
        The same effects with other laws: each is fitted, and the best is kept.
    noise : NoiseModel or None
        From which the fit of the noise begins; None: from that of the model that is extended.
    new_noise : bool
        Whether the noise is fitted from white noise as well, for processes that the effects stand in the place of.
    promised : float
        Log evidence over that of the model that is extended, in the linearised problem; infinity where the effect is
        not linear in its strength.
    """

    move: str
    effects: tuple[Effect, ...]
    starts: tuple[tuple[Effect, ...], ...] = ()
    laws: tuple[tuple[Effect, ...], ...] = ()
    noise: NoiseModel | None = None
    new_noise: bool = False
    promised: float = math.inf


@dataclass(frozen=True, eq=False, kw_only=True)
class Proposals:
    """The candidates of a model, scored.

    Parameters
    ----------
    scan : ScanResult
        With its null distribution: of the innovations under the model's own noise.
    candidates : tuple of ScoredCandidate
        Best linear evidence first: under the model's noise, or under the noise that is left beside the best of them,
        whichever is larger.
    instead : tuple of tuple of ScoredCandidate
        Those, one or two at once, that do best what the latent processes of the noise do; they are fitted whatever
        their gain.
    if_none_random : tuple of ScoredCandidate
        Where dry friction holds the machine at times: those that do best if no force is random.  The motion there is
        not that of the linearised problem, and random forces make up for the difference.
    refused : tuple of (Entry, str)
    owned : mapping of str to str
        Candidates, by ``kind@where``, that an uncertain parameter of the model stands for, and that parameter.
    alike : mapping of str to frozenset of str
        For every effect of the model the candidates that change the same as it, beside everything that is fitted.
    sticks : bool
        Whether the machine has dry friction and stands still at times.
    """

    scan: ScanResult
    candidates: tuple[ScoredCandidate, ...]
    instead: tuple[tuple[ScoredCandidate, ...], ...]
    if_none_random: tuple[ScoredCandidate, ...]
    refused: tuple[tuple[Entry, str], ...]
    owned: Mapping[str, str]
    alike: Mapping[str, frozenset[str]]
    sticks: bool

    def named(self, name: str) -> ScoredCandidate | None:
        """Return a candidate by its ``kind@where``; None if it was not scored."""
        return next((c for c in self.candidates if c.name == name), None)

    def ahead(self) -> list[ScoredCandidate]:
        """Return the candidates to fit in full: the best of those that differ in what they change.

        One that cannot pay for its name, chosen among so many, is not worth a fit.  Where dry friction holds a part of
        the machine the best steady force is fitted as well.
        """
        price = math.log(max(len(self.candidates), 1))
        chosen = list(_differing((c for c in self.candidates if c.gain > price), POLICY.refits))
        steady = [c for c in self.candidates if c.kind in STEADY and np.any(c.expected_strength)]
        if self.sticks and steady and steady[0] not in chosen:
            chosen.append(steady[0])
        return chosen

    def twins(self, name: str) -> list[ScoredCandidate]:
        """Return the candidates that change the same as another, in the direction that the residual asks for."""
        own = self.named(name)
        if own is None or not math.isfinite(own.gain):
            return []
        return [c for c in self.candidates if c is not own and math.isfinite(c.gain) and _same(c, own)]


def _same(one: ScoredCandidate, other: ScoredCandidate) -> bool:
    """Tell whether two candidates change the same; one with more strengths may contain the other and more."""
    if one.expected_strength.size != other.expected_strength.size:
        return False
    return canonical_correlation(one.direction, other.direction) >= POLICY.same_direction


def propose(
    likelihood: StageLikelihood,
    *,
    include: Sequence[str],
    exclude: Sequence[str],
    level: float,
    seed: int,
    progress: Callable[[str], None],
) -> Proposals:
    """Score every candidate on a stage's innovations.

    What is missing is first taken for noise, and the noise then hides it.  So the candidates are scored under the noise
    of the model as it is and under that which is left beside the best of them, and those that do what the latent
    processes do are listed besides.  All gains are over the model with its own noise.

    Parameters
    ----------
    likelihood : StageLikelihood
    include, exclude : sequence of str
        Patterns of the catalogue.
    level : float
        Family-wise significance level of everything that is asked.
    seed : int
    progress : callable
    """
    progress("what is random: sensor noise and latent forces")
    stage, problem, plain = likelihood.stage, likelihood.weighted, likelihood.linearised
    entries = entries_of(stage, include, exclude)
    present = {str(e) for e in stage.effects}
    entries = [e for e in entries if e.name not in present or e.kind.name in REPEATABLE]
    together, fitted = moving_together(plain), plain.sensitivities().names
    same_law = {
        e.name: name
        for e in entries
        if e.place is not None and (name := parameter_of_same_law(e, fitted, together[e.place.name]))
    }
    asked = [e for e in entries if e.name not in same_law]
    raw, refused = candidate_sensitivities(plain, asked, progress, stage.effects, curves=not stage.effects)
    progress(f"scores of {count_text(len(raw), 'candidate')}")
    residual, sens = problem.residual(), problem.sensitivities()
    noise = noise_floor(plain)
    scoring = _Scoring.of(problem, raw, noise, likelihood.noise.model).with_one_law_each()
    result = scan(
        residual,
        sens,
        scoring.white,
        level=level / LEVEL_SHARES,
        seed=seed,
        noise_floor=[stage.noise[c] for c in residual.channels],
        whiten=False,
        plain=scoring.scored,
    )
    likeness = parameter_likeness(sens)
    sticks = any(np.any(mask) for mask in likelihood.left_out)
    alike = likeness.alike(stage.effects, scoring.white, POLICY.same_direction)
    scorings = [scoring, *_scoring_beside_leading(likelihood, scoring, progress)]
    instead, if_none_random = _in_place_of_random(likelihood, scoring, progress)
    owned = same_law | _owned(scorings, likeness)
    refused += [(e, f"{owned[e.name]} of the model does the same, and is fitted") for e in entries if e.name in owned]
    # the direction decides what is alike: one metric for all
    directions = {c.name: c.direction for c in scorings[-1].ranked}
    best: dict[str, ScoredCandidate] = {}
    for c in (c for s in scorings for c in s.ranked if c.name not in owned):
        if c.name not in best or c.gain > best[c.name].gain:
            best[c.name] = replace(c, direction=directions.get(c.name, c.direction))
    candidates = sorted(best.values(), key=lambda c: -c.gain)
    return Proposals(
        scan=result,
        candidates=tuple(candidates),
        instead=instead,
        if_none_random=if_none_random if sticks else (),
        refused=tuple(refused),
        owned=owned,
        alike=alike,
        sticks=sticks,
    )


def parameter_of_same_law(entry: Entry, fitted: Sequence[str], together: Sequence[Place] = ()) -> str:
    """Return the fitted parameter of the machine that is the strength of an entry's law at its place; empty if none is.

    Two dry frictions between the same two parts are one dry friction, and so are those on both sides of a rigid gear:
    ``together`` are the places that move with that of the entry.
    """
    if entry.place is None:
        return ""
    parts = [part for place in (entry.place, *together) for part in (place.name, *place.also)]
    return next((name for part in parts for law in entry.kind.same_law if (name := f"{part}.{law}") in fitted), "")


def moving_together(linearised: LinearisedProblem) -> dict[str, list[Place]]:
    """Return for every place, by name, the others whose speed is in proportion to its own in all records."""
    places = linearised.system.places
    speeds = {}
    for place in places:
        rate = f"place.{place.name}.{place.motion_names()[1][0]}"
        runs = [linearised.nominal_outputs(i)[rate] for i in range(len(linearised.experiments))]
        speeds[place.name] = np.concatenate(runs)

    def proportional(one: np.ndarray, other: np.ndarray) -> bool:
        square = float(other @ other)
        off = one - (float(one @ other) / square if square > 0.0 else 0.0) * other
        return bool(np.max(np.abs(off), initial=0.0) <= RIGID * np.max(np.abs(one), initial=0.0))

    return {a.name: [b for b in places if b is not a and proportional(speeds[a.name], speeds[b.name])] for a in places}


@dataclass(frozen=True, eq=False, kw_only=True)
class _Scoring:
    """The candidates scored under one noise model.

    Parameters
    ----------
    problem : LinearisedProblem
        Weighted by that noise.
    raw, white : sequence of Candidate
        As changes of the outputs, and of the innovations.
    noise : ndarray, shape (n_channels,)
        Of the sensors, SI.
    scored : WhitenedProblem
    model : NoiseModel
    offset : float
        Log evidence of the stage with that noise over that with its own, both without a candidate.
    other_laws : mapping of str to ScoredCandidate
        Of the kinds that have two laws at a place, by name, the one that is not among the candidates.
    """

    problem: LinearisedProblem
    raw: Sequence[Candidate]
    white: Sequence[Candidate]
    noise: np.ndarray
    scored: WhitenedProblem
    model: NoiseModel
    offset: float
    other_laws: Mapping[str, ScoredCandidate] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        problem: LinearisedProblem,
        raw: Sequence[Candidate],
        noise: np.ndarray,
        model: NoiseModel,
        offset: float = 0.0,
        other_laws: Mapping[str, ScoredCandidate] | None = None,
    ) -> _Scoring:
        """Score candidates, given as changes of the outputs."""
        white = _whitened(raw, problem.weighting)
        scored = _scored(problem, problem.sensitivities(), white)
        return cls(
            problem=problem,
            raw=raw,
            white=white,
            noise=noise,
            scored=scored,
            model=model,
            offset=offset,
            other_laws=other_laws or {},
        )

    @classmethod
    def under(
        cls, likelihood: StageLikelihood, model: NoiseModel, own: _Scoring, raw: Sequence[Candidate]
    ) -> _Scoring | None:
        """Score candidates of the stage's own scoring under a noise model that is not its own.

        None where the likelihood cannot be computed under it: a machine that diverges leaves no digit of what little
        noise there is.
        """
        plain, fitted = likelihood.linearised, likelihood.noise
        columns, std, offset = record_columns(plain, fitted.records, likelihood.held)
        reached = restricted_log_likelihood(columns, model, std, offset) + log_price(plain, model)
        if not math.isfinite(reached):
            return None
        before = fitted.log_likelihood + log_price(plain, fitted.model)
        problem = plain.weighted_by(replace(fitted, model=model).weighting())
        return cls.of(problem, raw, own.noise, model, reached - before, own.other_laws)

    def with_one_law_each(self) -> _Scoring:
        """Return the same with the better law of every kind that has two at a place."""
        count = Counter(c.name for c in self.raw)
        if max(count.values(), default=0) <= 1:
            return self
        best = {c.name: c for c in reversed(self.raw)} | {c.name: c.candidate for c in reversed(self.ranked)}
        kept = [k for k, c in enumerate(self.raw) if count[c.name] == 1 or best[c.name] is c]
        white = [self.white[k] for k in kept]
        scored = _scored(self.problem, self.problem.sensitivities(), white)
        other = {c.name: c for c in self.ranked if best[c.name] is not c.candidate and math.isfinite(c.gain)}
        raw = [self.raw[k] for k in kept]
        return replace(self, raw=raw, white=white, scored=scored, other_laws=other)

    @cached_property
    def ranked(self) -> list[ScoredCandidate]:
        """The candidates at their best shapes, best first; their gain is over the model with its own noise."""
        ranked = _by_evidence(self.scored, self.raw, self.noise)
        others = self.other_laws
        return [replace(c, gain=c.gain + self.offset, noise=self.model, other_law=others.get(c.name)) for c in ranked]

    @property
    def leading(self) -> ScoredCandidate | None:
        """The best candidate; None if there is none, or if it would act the other way."""
        return self.ranked[0] if self.ranked and np.any(self.ranked[0].expected_strength) else None

    @cached_property
    def able(self) -> list[ScoredCandidate]:
        """Candidates that may explain something, those left out that a parameter of the model stands for."""
        owned = _owned([self], parameter_likeness(self.problem.sensitivities()))
        return [c for c in self.ranked if math.isfinite(c.gain) and c.name not in owned]

    @property
    def likeliest_pair(self) -> tuple[tuple[ScoredCandidate, ...], float]:
        """The two candidates that do most together, and their gain; minus infinity without two.

        Each pays for its strength and shape as it does alone.
        """
        best: tuple[tuple[ScoredCandidate, ...], float] = ((), -math.inf)
        for one, other in itertools.combinations(self.able, 2):
            gain = one.gain + other.gain - self.offset + gain_of_both(one.direction, other.direction, self.scored.e)
            if gain > best[1]:
                best = (one, other), gain
        return best

    def gain_beside(self, name: str, parameter: str) -> float:
        """Return by how much the log evidence rises with a candidate where a parameter is fitted without its prior.

        Both models have this noise, so that what it does not explain counts for neither.
        """
        k = next(k for k, c in enumerate(self.raw) if c.name == name)
        sens = self.problem.sensitivities()
        free = replace(sens, prior_std=np.where(np.array(sens.names) == parameter, np.inf, sens.prior_std))
        ranked = _by_evidence(_scored(self.problem, free, self.white[k : k + 1]), self.raw[k : k + 1], self.noise)
        return ranked[0].gain if ranked else -math.inf


def gain_of_both(one: np.ndarray, other: np.ndarray, residual: np.ndarray) -> float:
    """Return by how much the gains of two candidates, in log likelihood, exceed their sum where both are fitted.

    Parameters
    ----------
    one, other : ndarray, shape (n_rows, k)
        Orthonormal columns each.
    residual : ndarray, shape (n_rows,)
        With a variance of one.

    Returns
    -------
    float
        Minus infinity where both change the same.

    Examples
    --------
    Two that hide each other: alone each explains little of a residual that both explain whole.

    >>> a, b = np.array([[1.0], [0.0]]), np.array([[-0.8], [0.6]])
    >>> round(gain_of_both(a, b, np.array([1.0, 3.0])), 3)
    4.0
    """
    q, r = np.linalg.qr(other - one @ (one.T @ other))
    if np.min(np.abs(np.diag(r))) ** 2 < 1.0 - POLICY.same_direction**2:
        return -math.inf
    beside, alone = q.T @ residual, other.T @ residual
    return 0.5 * float(beside @ beside - alone @ alone)


def _in_place_of_random(
    likelihood: StageLikelihood, own: _Scoring, progress: Callable[[str], None]
) -> tuple[tuple[tuple[ScoredCandidate, ...], ...], tuple[ScoredCandidate, ...]]:
    """Return the candidates, or pairs, that do what the latent processes of the noise do, and those best without any.

    They are sought without each of the processes, and without all of them, and come in turns: the best for each, the
    second best, and so on.  A candidate must regain the usual share, less the error of a linear gain; two at once are
    sought only where none does.
    What a parameter of the model stands for is decided there too: beside a process that does the same as a candidate,
    what is left of it looks like anything.
    The mean of a process with a long memory is listed besides: a process is taken to have none, and grows to hold it.
    What a large effect leaves of the residual in the linearised problem says little of what it leaves in truth, so only
    a fit tells what is random beside it.
    """
    model = likelihood.noise.model
    fewer = [tuple(q for q in model.processes if q is not process) for process in model.processes]
    at_best_shapes = [c.at_one_shape for c in own.ranked]
    losses: list[tuple[float, list[tuple[ScoredCandidate, ...]]]] = []
    best_without: list[ScoredCandidate] = []
    for processes in dict.fromkeys([*fewer, ()] if model.processes else []):
        progress("which effect could explain what is taken for random")
        without = _Scoring.under(likelihood, replace(model, processes=processes), own, at_best_shapes)
        if without is None:
            continue
        lost = min(without.offset, -1.0)
        singles: list[tuple[ScoredCandidate, ...]]
        singles = [(c,) for c in without.able if 1.0 - c.gain / lost > REGAINED * (1.0 - POLICY.linear_error)]
        pair, gain = without.likeliest_pair if not singles else ((), -math.inf)
        losses.append((lost, [pair] if 1.0 - gain / lost > REGAINED else singles))
        best_without = without.able if not processes else []
    # in turns: the best for each set of processes first
    by_loss = [explanations for _, explanations in sorted(losses, key=lambda t: t[0])]
    leaders: list[tuple[ScoredCandidate, ...]] = []
    for explanation in (e for turn in itertools.zip_longest(*by_loss) for e in turn if e):
        if not any(_do_the_same(explanation, other) for other in leaders):
            leaders.append(explanation)
    leaders = leaders[:REFITTED]
    slow = [q for q in model.processes if q.memory > LONG_MEMORY * likelihood.duration]
    means = {f"{kind}@{q.where}" for q in slow for kind in MEANS}
    steady = [(c,) for c in own.ranked if c.name in means and np.any(c.expected_strength)]
    instead = (*leaders, *(each for each in steady if not any(_do_the_same(each, other) for other in leaders)))
    return instead, _differing(best_without, POLICY.rivals)


def _differing(candidates: Iterable[ScoredCandidate], most: int) -> tuple[ScoredCandidate, ...]:
    """Return the first so many candidates that are strong at all and differ in what they change."""
    chosen: list[ScoredCandidate] = []
    for c in candidates:
        if len(chosen) == most:
            break
        if np.any(c.expected_strength) and not any(_same(c, other) for other in chosen):
            chosen.append(c)
    return tuple(chosen)


def _do_the_same(one: Sequence[ScoredCandidate], other: Sequence[ScoredCandidate]) -> bool:
    return len(one) == len(other) and all(any(a.name == b.name or _same(a, b) for b in other) for a in one)


def _scoring_beside_leading(
    likelihood: StageLikelihood, own: _Scoring, progress: Callable[[str], None]
) -> list[_Scoring]:
    """Return the scores under the noise that is left beside the best candidate; none without a candidate."""
    leading = own.leading
    if leading is None:
        return []
    progress(f"the noise that is left beside {leading.name}")
    beside = _noise_beside(likelihood, leading)
    scoring = _Scoring.under(likelihood, beside, own, own.raw)
    return [scoring] if scoring is not None else []


def _owned(scorings: Sequence[_Scoring], likeness: ParameterLikeness) -> dict[str, str]:
    """Return the candidates that an uncertain parameter of the model stands for, and that parameter.

    It stands for a candidate that changes the same, and that pays for its name in no scoring once the parameter is free
    to leave its stated value.  What a candidate gains then, it gains by what it changes otherwise than the parameter:
    radiation is nearly proportional to a temperature, as a loss through the wall is, and yet good records tell them
    apart.
    """
    first = scorings[0]
    white = {c.name: c for c in first.white}
    price = math.log(max(len(first.ranked), 1))
    owned = {}
    for c in first.ranked:
        columns = white[c.name].sensitivities[c.candidate.shapes.index(c.shape)]
        name = likeness.owner([z @ c.expected_strength for z in columns])
        if name and all(s.gain_beside(c.name, name) <= price for s in scorings):
            owned[c.name] = name
    return owned


def _whitened(candidates: Sequence[Candidate], weighting: Sequence[Weighting]) -> list[Candidate]:
    def of(blocks: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
        return tuple(w(b) for w, b in zip(weighting, blocks, strict=True))

    return [replace(c, sensitivities=tuple(of(blocks) for blocks in c.sensitivities)) for c in candidates]


def _scored(problem: LinearisedProblem, sens: Sensitivities, white: Sequence[Candidate]) -> WhitenedProblem:
    """Return candidates in innovations, whose variance is one by construction."""
    residual = problem.residual()
    unit = identity([1.0] * len(residual.channels), residual.channels, residual.dt)
    return whiten_all(unit, residual, sens, white)


def _by_evidence(w: WhitenedProblem, raw: Sequence[Candidate], noise: np.ndarray) -> list[ScoredCandidate]:
    """Return every candidate at its best shape, ordered by linear evidence; last those that would act the other way."""
    if w.scorer is None:
        return []
    scores = w.scorer(w.e[:, None])
    best: dict[int, tuple[float, int, np.ndarray]] = {}
    for g, group in enumerate(w.columns.groups):
        candidate = raw[group.candidate]
        amplitude = scores.amplitude[group.columns, 0]
        strength, covariance = w.scorer.strength(g, amplitude)
        scale = strength_scale(candidate.sensitivities[group.shape], noise)
        k = strength.size
        gain = 0.5 * float(amplitude @ amplitude) + log_prior_of_strengths(strength, scale, candidate.one_sided)
        gain += 0.5 * k * math.log(2.0 * math.pi) + 0.5 * float(np.linalg.slogdet(covariance)[1])
        gain -= math.log(len(candidate.shapes))
        if not np.any(strength):  # of one sign only, and the residual asks for the other
            gain = -math.inf
        if group.candidate not in best or gain > best[group.candidate][0]:
            best[group.candidate] = gain, g, strength
    out = [
        ScoredCandidate(
            candidate=raw[c],
            shape=dict(raw[c].shapes[w.columns.groups[g].shape]),
            expected_strength=strength,
            gain=gain,
            direction=w.columns.Z[w.columns.groups[g].columns],
        )
        for c, (gain, g, strength) in best.items()
    ]
    return sorted(out, key=lambda c: -c.gain)


def _noise_beside(likelihood: StageLikelihood, scored: ScoredCandidate) -> NoiseModel:
    """Return the noise of a model that has a candidate in it, in the linearised problem."""
    plain, fitted = likelihood.linearised, likelihood.noise
    columns, std, offset = record_columns(plain, fitted.records, likelihood.held)
    k = scored.candidate.shapes.index(scored.shape)
    more = scored.candidate.sensitivities[k]
    width = more[0].shape[2]
    return fitted_noise(
        plain,
        fitted.records,
        with_columns(columns, more),
        np.concatenate([std, np.full(width, np.inf)]),
        np.concatenate([offset, np.zeros(width)]),
        fitted.model,
        grow=False,
    ).model


def proposed_effects(scored: ScoredCandidate, effects: Sequence[Effect]) -> Proposal:
    """Return the model with a candidate added to some effects, in place of those that it contains."""
    entry = scored.entry
    simpler = simpler_in(effects, scored.kind, scored.where)
    kept = tuple(e for e in effects if e not in simpler)
    expected = effect_of(entry, scored, effects, simpler)
    starts: list[tuple[Effect, ...]] = []
    if not entry.kind.linear:
        sizes = {float(s["amplitude"]) for s in scored.candidate.shapes if s.get("amplitude", 0.0) > 0.0}
        starts = [(*kept, replace(expected, strengths=dict.fromkeys(expected.strengths, z))) for z in sorted(sizes)]
    other = scored.other_law
    return Proposal(
        move="exchange" if simpler else "add",
        effects=(*kept, expected),
        starts=tuple(starts),
        laws=() if other is None else ((*kept, effect_of(other.entry, other, effects, simpler)),),
        noise=scored.noise,
        promised=scored.gain if entry.kind.linear else math.inf,
    )
