"""False alarms on the residual of a real machine: the residual of the best model, resampled and added to that model.

Data made of the best model and its own residual in another order lack no effect.  The residual keeps its colour, its
bursts and its tails, and loses its relation to the motion.  Whatever a scan then names is a false alarm.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.statistics.blocks import Array, Candidate, Residual, Sensitivities

if TYPE_CHECKING:
    from discrepancy.stages.stage import Stage
    from discrepancy.statistics.scan_result import ScanResult
    from discrepancy.statistics.whitened import WhitenedProblem

__all__ = [
    "SCHEMES",
    "Resampled",
    "ResamplingData",
    "best_stage",
    "read_resampled",
    "resample",
    "resampled_alarms",
]

SHIFT = "circular shift and sign"
SCHEMES = ("block bootstrap", SHIFT, "pieces shuffled and turned")
#: Autocorrelation of an input from which a shifted residual still follows the motion.
REPEATS = 0.8
#: Mean length of a block as a multiple of the residual's correlation time, and its least share of a record.
MEMORIES, LEAST = 5.0, 0.01
FEW = 12  # blocks of that length in all records, below which a resampled residual hardly differs from the original


@dataclass(frozen=True, kw_only=True)
class Resampled:
    """One resampled residual and what the scans found in it.

    Parameters
    ----------
    number : int
        Seed of the resampling.
    scheme : str
        One of `SCHEMES`.
    plain, whitened, curves : str
        What the plain scan, the whitened scan and the scan of free curves declare missing; empty for nothing.
    p : float
        Smallest family-wise p of them.
    pairs : str
        The same for masking pairs.
    """

    number: int
    scheme: str
    plain: str
    whitened: str
    curves: str
    p: float
    pairs: str = ""

    @property
    def alarm(self) -> bool:
        """True if any of the scans declares anything missing."""
        return bool(self.plain or self.whitened or self.pairs or self.curves)


def resample(blocks: Sequence[Array], scheme: str, memory: float, rng: np.random.Generator) -> list[Array]:
    """Return residuals of the same lengths, made of pieces of the given ones; the outputs stay together.

    Parameters
    ----------
    blocks : sequence of ndarray, shape (n_t, n_channels)
    scheme : str
        ``"block bootstrap"``: blocks of random length, drawn with replacement (Politis and Romano 1994);
        ``"circular shift and sign"``: each record shifted as a whole; ``"pieces shuffled and turned"``: pieces of
        random length, each with a random sign and half of them backwards in time.
    memory : float
        Correlation length of the residual, samples.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> made = resample([np.arange(200.0)[:, None]], "circular shift and sign", 3.0, rng)
    >>> sorted(np.abs(made[0][:, 0])) == list(range(200))
    True
    """
    made = []
    for block in blocks:
        n = len(block)
        mean = max(MEMORIES * memory, LEAST * n, 8.0)
        if scheme == SHIFT:
            made.append(np.roll(block, int(rng.integers(n)), axis=0) * rng.choice([-1.0, 1.0]))
            continue
        parts: list[Array] = []
        filled = 0
        while filled < n:
            size = min(1 + int(rng.geometric(1.0 / mean)), n - filled)
            source = blocks[int(rng.integers(len(blocks)))]
            part = source[(int(rng.integers(len(source))) + np.arange(size)) % len(source)]
            if scheme == "pieces shuffled and turned":
                part = (part if rng.random() < 0.5 else part[::-1]) * rng.choice([-1.0, 1.0])
            parts.append(part)
            filled += size
        made.append(np.concatenate(parts))
    return made


def repeats(stage: Stage) -> tuple[float, float]:
    """Return the lag at which an input's autocorrelation peaks again, s, and the autocorrelation there.

    The residual of a record that repeats itself still follows the motion after a circular shift, because the shifted
    motion is a function of the motion.
    """
    best = (0.0, 0.0)
    for fit in stage.identify.fits:
        record = fit.experiment.record
        for name in fit.experiment.inputs:
            x = np.asarray(record.signals[name].values, dtype=float)
            x = x - np.mean(x)
            power = float(x @ x)
            if power == 0.0:
                continue
            like = np.fft.irfft(np.abs(np.fft.rfft(x)) ** 2, x.size) / power
            below = np.flatnonzero(like < 0.5)
            if below.size == 0:
                continue
            lag = int(below[0] + np.argmax(like[below[0] : x.size // 2 + 1]))
            if like[lag] > best[1]:
                best = (float(record.time[lag] - record.time[0]), float(like[lag]))
    return best


@dataclass(frozen=True, eq=False, kw_only=True)
class ResamplingData:
    """What all trials share: the machine's sensitivities, and the residual that is resampled.

    Parameters
    ----------
    residual : Residual
        Of the best model, as the scan sees it.
    sens : Sensitivities
    candidates, curves : tuple of Candidate
        Laws and sensors' errors; free curves.
    laws, free : WhitenedProblem
        Both with each output divided by its residual's root mean square.
    floor : tuple of float
        Noise of each output.
    source : list of ndarray, shape (n_t, n_channels)
        The residual without what calibration explains, of each record.
    memory : float
        Its correlation length, samples.
    schemes : tuple of str
        Those of `SCHEMES` that break its relation to the motion.
    """

    residual: Residual
    sens: Sensitivities
    candidates: tuple[Candidate, ...]
    curves: tuple[Candidate, ...]
    laws: WhitenedProblem
    free: WhitenedProblem
    floor: tuple[float, ...]
    source: list[Array]
    memory: float
    schemes: tuple[str, ...]

    @classmethod
    def of_stage(cls, stage: Stage, progress: Callable[[str], None] = lambda text: None) -> ResamplingData:
        """Return it for the best model."""
        from discrepancy.effects.catalogue import catalogue
        from discrepancy.sensitivities.candidates import candidate_sensitivities
        from discrepancy.sensitivities.free_curve_scan import free_curve_candidates

        progress("sensitivities of all candidates")
        linearised = stage.linearised_problem()
        experiment = stage.identify.fits[0].experiment
        entries = catalogue(stage.system, experiment.outputs, experiment.inputs)
        candidates, _ = candidate_sensitivities(linearised, entries)
        residual = linearised.residual()
        return cls.of_arrays(
            residual,
            linearised.sensitivities(),
            candidates,
            free_curve_candidates(linearised, stage.system.places),
            [stage.noise[c] for c in residual.channels],
            [s for s in SCHEMES if s != SHIFT or repeats(stage)[1] < REPEATS],
        )

    @classmethod
    def of_arrays(
        cls,
        residual: Residual,
        sens: Sensitivities,
        candidates: Sequence[Candidate],
        curves: Sequence[Candidate],
        floor: Sequence[float],
        schemes: Sequence[str],
    ) -> ResamplingData:
        """Return it for given arrays."""
        from discrepancy.statistics.null_distribution import correlation_length
        from discrepancy.statistics.whitened import raw_residual, scaled_by_rms

        laws, free = (scaled_by_rms(residual, sens, what) for what in (candidates, curves))
        source = raw_residual(laws, residual, sens, [], [])
        memory = correlation_length(laws.projection.layout, laws.e)
        return cls(
            residual=residual,
            sens=sens,
            candidates=tuple(candidates),
            curves=tuple(curves),
            laws=laws,
            free=free,
            floor=tuple(floor),
            source=source,
            memory=memory,
            schemes=tuple(schemes),
        )

    def draw(self, number: int) -> tuple[str, Residual]:
        """Return the scheme of a trial, and its residual."""
        scheme = self.schemes[number % len(self.schemes)]
        rng = np.random.default_rng([number, 77])
        made = resample(self.source, scheme, self.memory, rng)
        return scheme, Residual(made, self.residual.dt, self.residual.channels)

    @property
    def caution(self) -> str:
        """Warning where the residual is correlated for so long that resampling hardly changes it; else empty."""
        samples, dt = sum(len(block) for block in self.source), self.residual.dt
        blocks = samples / (MEMORIES * self.memory)
        if blocks >= FEW:
            return ""
        return (
            f"The residual is correlated over {self.memory * dt:.2g} s, and all records together last "
            f"{samples * dt:.3g} s: {blocks:.1f} blocks of {MEMORIES:g} times that. Residuals made of so few pieces "
            "differ little from the original, and alarms on them may come from what it contains. Record longer, or "
            "more often."
        )

    def plain(self, made: Residual, *, curves: bool = False) -> WhitenedProblem:
        """Return a trial's residual, with calibration projected out, for the laws or for the free curves."""
        known, of_laws = self.free if curves else self.laws, self.laws
        given = np.isfinite(self.sens.prior_std)
        prior = self.sens.prior_offset[given] / self.sens.prior_std[given]
        e_raw = of_laws.projection.layout.stack(of_laws.whitener, made.blocks, prior)
        return replace(known, e_raw=e_raw, e=of_laws.projection.remove(e_raw.copy()))


def resampled_alarms(
    given: ResamplingData,
    trials: int,
    out: Path,
    *,
    level: float,
    seed: int = 0,
    progress: Callable[[str], None] = lambda text: None,
) -> list[Resampled]:
    """Scan resampled residuals; an interrupted run continues.

    Repeated for every trial: the whitening filters, the projection of the residual, all scores and all null
    distributions of the three scans and of the pairs.  Done once: the simulation, its sensitivities, those of the
    candidates, and the weights of the outputs in the scans that do not whiten; the projection recalibrates to first
    order.  Left out: the refit in full simulation, which demands that BIC falls and that the change reaches the noise
    floor, and can only remove alarms.

    Parameters
    ----------
    given : ResamplingData
        Of the best model.
    trials : int
    out : Path
        Folder of ``resampled.jsonl``.
    level : float
        Of the study; each look has its share.
    seed : int
        First number.
    """
    from discrepancy.effects.from_scan_row import contained
    from discrepancy.sensitivities.free_curve_scan import significant_and_predictive
    from discrepancy.statistics.masking_pairs import find_masking_pairs
    from discrepancy.statistics.scan import scan, score_candidates
    from discrepancy.statistics.thresholds import LEVEL_SHARES
    from discrepancy.statistics.verdicts import Verdict

    out.mkdir(parents=True, exist_ok=True)
    path = out / "resampled.jsonl"
    done = read_resampled(path)
    left = sorted(set(range(seed, seed + trials)) - {t.number for t in done})
    if not left:
        return done

    def look(which: str, made: Residual, number: int) -> ScanResult:
        if which == "whitened":
            share = level / LEVEL_SHARES
            return scan(made, given.sens, given.candidates, level=share, seed=number, noise_floor=given.floor)
        w = given.plain(made, curves=which == "curves")
        what = given.curves if which == "curves" else given.candidates
        return score_candidates(
            w, made, given.sens, what, level / LEVEL_SHARES, 400, np.random.default_rng(number), given.floor
        )

    with path.open("a") as stream:
        for count, number in enumerate(left, 1):
            scheme, made = given.draw(number)
            names, least = {"plain": "", "whitened": "", "pairs": "", "curves": ""}, 1.0
            scans = []
            for which in ("plain", "whitened", "curves"):  # the first that finds something ends the trial
                result = look(which, made, number)
                scans.append(result)
                curves = which == "curves"
                missing = [
                    r
                    for r in result.rows
                    if (significant_and_predictive(r) if curves else r.verdict is Verdict.MISSING)
                ]
                least = min([least, *(r.p_value for r in result.rows)])
                if missing:
                    names[which] = missing[0].name
                    break
                if which == "whitened":
                    both = find_masking_pairs(scans, contained, level=level / LEVEL_SHARES, seed=number)
                    if both is not None:
                        least, names["pairs"] = min(least, both.p_value), " and ".join(both.pairs[0].names)
                        break
            trial = Resampled(number=number, scheme=scheme, **names, p=float(least))
            stream.write(json.dumps(asdict(trial)) + "\n")
            stream.flush()
            done.append(trial)
            progress(
                f"resampled {count}/{len(left)}, {scheme}: {', '.join(n for n in names.values() if n) or 'nothing'}"
            )
    return done


def best_stage(study_file: Path, out: Path, progress: Callable[[str], None] = lambda text: None) -> tuple[Stage, float]:
    """Return the best model of a study and its level; diagnosed once, later fitted again from ``best.json``."""
    from discrepancy.effects.effect import Effect
    from discrepancy.study.study import Study

    study = Study.from_file(study_file, progress=progress)
    path = out / "best.json"
    if not path.exists():
        study.diagnose()
        out.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps([asdict(e) for e in study.stage.effects], indent=1) + "\n")
        return study.stage, study.problem.level
    effects = tuple(Effect(**{**e, "ports": tuple(e["ports"])}) for e in json.loads(path.read_text()))
    first = study.stage
    return study.fitted("best", effects, first, first.noise), study.problem.level


def read_resampled(path: Path) -> list[Resampled]:
    """Read the trials of an earlier run."""
    if not path.exists():
        return []
    return [Resampled(**json.loads(line)) for line in path.read_text().splitlines() if line.strip()]
