"""The omnibus test: whether anything is missing at all, without a catalogue.

A coloured residual alone proves nothing: a disturbance is coloured too.  But a disturbance does not follow the
machine's own motion or inputs every time.  So the residual is tested against flexible functions of the drivers
(reference, speed, position, input): delayed copies, and free curves of their value.  They are scored like any
candidate, with the same projection, whitening and null distribution.  Symptoms without that guarantee (portmanteau,
variance in motion against rest, low-frequency energy) are reported and do not decide.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.statistics.blocks import Array, Candidate, Residual, Sensitivities
from discrepancy.statistics.hat_functions import hat_functions, quantile_knots
from discrepancy.statistics.null_distribution import cut_pieces, shuffled_residuals
from discrepancy.statistics.scan import scan
from discrepancy.statistics.scan_result import ScanResult
from discrepancy.statistics.verdicts import Verdict

if TYPE_CHECKING:
    from discrepancy.stages.stage import Stage

LAGS_S = (0.0, 0.01, 0.03, 0.1, 0.3)
N_COARSE = 7
N_FINE = 17
FINE = "fine curve"


@dataclass(frozen=True, kw_only=True)
class Omnibus:
    """Result of the omnibus test.

    Attributes
    ----------
    p : float
        Family-wise p-value that the residual follows some driver by an amount that matters, in records left out as
        well; 1 where none does.
    rejects : bool
        True if p is below the level: something is missing or wrong, whatever the catalogue says.
    leading : str
        The driver and channel with the smallest p-value.
    symptoms : dict
        Name → (value, p or nan, meaning).  They describe and do not decide.
    """

    p: float
    rejects: bool
    leading: str
    symptoms: dict[str, tuple[float, float, str]]
    scan: ScanResult

    @property
    def sentence(self) -> str:
        """The statement for a search that found no effect."""
        if not self.rejects:
            return "The residual does not follow the machine's inputs either."
        return (
            f"But the residual still follows the machine's inputs ({self.leading}, p = {self.p:.2g}): something is "
            "missing or wrong that neither an effect of the catalogue nor a force at a connection explains."
        )

    def __repr__(self) -> str:
        word = "something is missing" if self.rejects else "nothing follows the machine's own motion"
        lines = [f"Omnibus: {word} (p = {self.p:.2g}; most in {self.leading})"]
        lines += [
            f"  {k}: {v:.3g}" + (f", p = {p:.2g}" if np.isfinite(p) else "") + f" ({m})"
            for k, (v, p, m) in self.symptoms.items()
        ]
        return "\n".join(lines)


def generic_candidates(
    residual: Residual, drivers: Mapping[str, Sequence[Array]], coarse: Collection[str] = ()
) -> list[Candidate]:
    """Delayed copies and free curves of each driver, in each output; no fine curves of the ``coarse`` ones."""
    out = []
    C = len(residual.channels)

    def place(column: Array, c: int, b: int) -> Array:
        z = np.zeros((len(column), C, column.shape[1]))
        z[:, c] = column
        return residual.weighting[b](z) if residual.weighting else z

    for name, blocks in drivers.items():
        signal = [np.asarray(b, dtype=float) for b in blocks]
        pooled = np.concatenate(signal)
        if np.ptp(pooled) == 0:
            continue
        mean = float(np.mean(pooled))
        lags = sorted({round(s / residual.dt) for s in LAGS_S})
        curves = {"curve": quantile_knots(pooled, N_COARSE)}
        if name not in coarse:
            curves[FINE] = quantile_knots(pooled, N_FINE)
        for c, channel in enumerate(residual.channels):
            grid = []
            for lag in lags:
                grid.append(
                    tuple(
                        place(
                            np.concatenate([np.full(min(lag, len(s)), s[0]), s[: max(len(s) - lag, 0)]])[:, None]
                            - mean,
                            c,
                            b,
                        )
                        for b, s in enumerate(signal)
                    )
                )
            out.append(
                Candidate(
                    kind=f"delayed {name}",
                    where=channel,
                    sensitivities=tuple(grid),
                    shapes=tuple({"lag": lag * residual.dt} for lag in lags),
                )
            )
            for kind, knots in curves.items():
                if len(knots):
                    # One hat function is left out: their sum is an offset, which the catalogue holds.
                    cols = tuple(place(hat_functions(s, knots)[:, 1:], c, b) for b, s in enumerate(signal))
                    out.append(Candidate(kind=f"{kind} of {name}", where=channel, sensitivities=(cols,)))
    return out


def omnibus_of_stage(stage: Stage, *, level: float, draws: int = 200, seed: int = 0) -> Omnibus | None:
    """Test a stage of a study against its recorded inputs and their rates; None if the inputs do not change.

    Inputs with feedback from the residual (`discrepancy.sensitivities.input_feedback`) are left out: they follow it in
    any case.
    """
    from discrepancy.sensitivities.input_feedback import inputs_with_feedback

    preparation = stage.scan_preparation
    problem = stage.weighted_problem()
    with_feedback = inputs_with_feedback(stage.linearised_problem(preparation))
    drivers: dict[str, list[Array]] = {}
    rates = set()
    for experiment in problem.experiments:
        time = np.asarray(experiment.record.time)
        for name in (n for n in experiment.inputs if n not in with_feedback):
            u = np.asarray(experiment.record.signals[name].values)
            rates.add(rate := f"rate of {name}")
            for driver, x in ((name, u), (rate, np.gradient(u, time))):
                drivers.setdefault(driver, []).append(np.interp(experiment.time, time, x))
    drivers = {n: x for n, x in drivers.items() if np.ptp(np.concatenate(x)) > 0.0}
    if not drivers:
        return None
    floor = [stage.noise[c] for c in problem.residual().channels]
    return omnibus(
        problem.residual(),
        problem.sensitivities(),
        drivers,
        level=level,
        draws=draws,
        seed=seed,
        coarse=rates,
        noise_floor=floor,
    )


def omnibus(
    residual: Residual,
    sensitivities: Sensitivities,
    drivers: Mapping[str, Sequence[Array]],
    *,
    moving: Sequence[Array] | None = None,
    level: float = 0.02,
    draws: int = 400,
    seed: int = 0,
    coarse: Collection[str] = (),
    noise_floor: Sequence[float] | None = None,
) -> Omnibus:
    """Test whether the calibrated residual still follows the machine's motion or inputs.

    Parameters
    ----------
    residual, sensitivities
        As for `scan`.
    drivers : mapping of str to sequence of ndarray, shape (n_t,)
        Signals that a missing effect would follow: reference, speed, position, input. Not measured outputs,
        which carry the disturbance themselves.
    moving : sequence of bool ndarray, shape (n_t,), optional
        When the machine moves; adds the variance in motion against rest.
    level, draws, seed, noise_floor
        As for `scan`.
    coarse : collection of str
        Drivers of which no fine curve is tried, as rates of inputs.
    """
    bad = [
        f"driver {k}: {[len(b) for b in v]} samples for {[len(b) for b in residual.blocks]}"
        for k, v in drivers.items()
        if [len(b) for b in v] != [len(b) for b in residual.blocks]
    ]
    if bad:
        raise ValueError("; ".join(bad))
    generic = generic_candidates(residual, drivers, coarse)
    few = [c for c in generic if not c.kind.startswith(FINE)]
    r = scan(residual, sensitivities, generic, level=level, draws=draws, seed=seed, noise_floor=noise_floor, few=few)
    matter = [row for row in r.rows if row.verdict is not Verdict.NEGLIGIBLE and row.carries_over]
    best = min(matter, key=lambda x: x.p_value) if matter else None
    p = best.p_value if best else 1.0
    symptoms = {"portmanteau": _portmanteau(r), "low-frequency energy": _low_frequency(r)}
    if moving is not None:
        symptoms["motion against rest"] = _motion(r, moving, draws, seed)
    return Omnibus(p=p, rejects=p < level, leading=best.name if best else "none", symptoms=symptoms, scan=r)


def _portmanteau(r: ScanResult) -> tuple[float, float, str]:
    from scipy.stats import chi2

    lay = r.projection.layout
    q, h = 0.0, 20
    for c in range(lay.n_channels):
        for b, n in enumerate(lay.lengths):
            x = lay.view(r.whitened_residual, b)[:, c]
            den = float(x @ x)
            if den > 0 and n > 2 * h:
                rho = np.array([x[k:] @ x[:-k] for k in range(1, h + 1)]) / den
                q += n * (n + 2) * float(np.sum(rho**2 / (n - np.arange(1, h + 1))))
    dof = h * lay.n_channels * len(lay.lengths)
    return (
        q / dof,
        float(chi2.sf(q, dof)),
        "Ljung–Box per degree of freedom after whitening; 1 if the filter took all colour",
    )


def _low_frequency(r: ScanResult) -> tuple[float, float, str]:
    if r.scorer is None:
        return float("nan"), float("nan"), "no candidate to measure it with"
    bands = r.scorer.variance.bands
    S = bands.normalised(bands.cross(r.whitened_residual[:, None]))
    value = float(np.mean(np.einsum("cc->c", S[0, :, :, 0]).real))
    return value, float("nan"), f"variance below {bands.edges[1]:.3g} Hz relative to white"


def _motion(r: ScanResult, moving: Sequence[Array], draws: int, seed: int) -> tuple[float, float, str]:
    lay = r.projection.layout
    mask = np.concatenate([np.repeat(np.asarray(m, dtype=bool), lay.n_channels) for m in moving])
    if mask.all() or not mask.any():
        return float("nan"), float("nan"), "the records never rest or never move"

    def ratio(x: Array) -> Array:
        d = x[: lay.n_data]
        out: Array = np.mean(d[mask] ** 2, axis=0) / np.mean(d[~mask] ** 2, axis=0)
        return out

    observed = float(ratio(r.whitened_residual[:, None])[0])
    pieces = cut_pieces(lay, r.whitener.dt, r.whitened_residual)
    rng = np.random.default_rng(seed)
    by_chance = np.concatenate(
        [ratio(E) for E in shuffled_residuals(r.whitened_residual, r.projection, pieces, draws, rng)]
    )
    p = (1.0 + float(np.sum(by_chance >= observed))) / (len(by_chance) + 1.0)
    return observed, p, "variance in motion over variance at rest; noise in motion alone also raises it"
