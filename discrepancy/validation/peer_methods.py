"""Other methods to decide what is missing: sparse regression, lasso, every candidate by a criterion, a black box.

Each takes a `PeerCase`, or only its regression, and returns the candidates that it names, the weightiest first.
  Settings are chosen as their authors advise, by error on trips left out, and are not tuned to the cases of the
comparison.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from discrepancy.statistics.blocks import Array
from discrepancy.statistics.thresholds import DECISIVE_BIC
from discrepancy.validation.peer_case import PeerCase, RegressionCase, RegressionData

__all__ = [
    "GAUSSIAN_PROCESS",
    "METHODS",
    "REGRESSION_METHODS",
    "THRESHOLDS",
    "Answer",
    "methods_on",
    "residual_process",
    "stlsq_at",
    "versions",
]

THRESHOLDS = (0.02, 0.03, 0.05, 0.08, 0.12, 0.2, 0.3, 0.45, 0.7)
RIDGES = (1e-6, 1e-3, 1e-2, 1e-1)
ENSEMBLE = 40
ENSEMBLE_ROWS = 3000
GP_POINTS = 500
FORWARD = 6
GAUSSIAN_PROCESS = "Gaussian process"


@dataclass(frozen=True)
class Answer:
    """What a method names.

    Parameters
    ----------
    named : tuple of str
        ``kind@where``, the weightiest first.
    ties : tuple of str
        What it cannot distinguish from the first.
    ratio : float
        Error on held-out records as a share of that of the recalibrated model.
    alarm : bool
        Whether it reports that something is missing.
    """

    named: tuple[str, ...]
    ratio: float
    alarm: bool
    ties: tuple[str, ...] = ()


def versions() -> dict[str, str]:
    """Return the versions of the programs compared."""
    from importlib.metadata import version

    return {n: version(n) for n in ("pysindy", "scikit-learn", "numpy", "scipy")}


def _named(case: RegressionCase, seen: RegressionData, coefficients: Array) -> Answer:
    """Turn a sparse vector of coefficients into names: by weight, without those of an impossible sign."""
    chosen = list(dict.fromkeys(seen.owner[np.flatnonzero(coefficients)].tolist()))
    possible = []
    for c in chosen:
        rows = np.flatnonzero(seen.owner == c)
        if not (case.candidates[c].one_sided and np.all(coefficients[rows] <= 0.0)):
            possible.append(c)
    weight = {c: float(np.sum(coefficients[seen.owner == c] ** 2)) for c in possible}
    order = sorted(possible, key=lambda c: -weight[c])
    return Answer(tuple(case.candidates[c].name for c in order), case.held_out(order), bool(order))


# -------------------------------------------------------------------- sequentially thresholded least squares


def _stlsq(X: Array, y: Array, threshold: float, ridge: float) -> Array:
    from pysindy import STLSQ

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that every coefficient was set to zero is an answer here
        fitted = STLSQ(threshold=threshold, alpha=ridge, max_iter=20).fit(X, y[:, None])
    out: Array = np.asarray(fitted.coef_)[0]
    return out


@lru_cache(maxsize=1)  # used by every method on the same regression
def _triangles(seen: RegressionData) -> list[Array]:
    """Return the triangular factor of (X, e) for each trip: least squares on it is least squares on the trip."""
    scale = float(np.linalg.norm(seen.e))
    return [np.asarray(np.linalg.qr(np.column_stack([seen.X[t], seen.e[t] / scale]), mode="r")) for t in seen.trips]


@lru_cache(maxsize=1)
def _settings(seen: RegressionData) -> list[tuple[float, float, float]]:
    """Return (error on trips left out, threshold, ridge) of every setting, best first."""
    parts = _triangles(seen)
    settings = []
    for ridge in RIDGES:
        for threshold in THRESHOLDS:
            error = 0.0
            for k, out in enumerate(parts):
                rest = np.concatenate([p for j, p in enumerate(parts) if j != k])
                c = _stlsq(rest[:, :-1], rest[:, -1], threshold, ridge)
                error += float(np.sum((out[:, -1] - out[:, :-1] @ c) ** 2))
            settings.append((error, threshold, ridge))
    return sorted(settings)


def stlsq(case: RegressionCase) -> Answer:
    """PySINDy's STLSQ on the scan's columns; threshold and ridge by error on trips left out."""
    seen = case.plain
    _, threshold, ridge = _settings(seen)[0]
    return stlsq_at(case, threshold, ridge)


def stlsq_at(case: RegressionCase, threshold: float, ridge: float) -> Answer:
    """PySINDy's STLSQ on the scan's columns with a threshold and a ridge that were not chosen by error.

    Columns and residual have length one: a threshold of 0.1 keeps what explains 1 % of the residual by itself.
    """
    rows = np.concatenate(_triangles(case.plain))
    return _named(case, case.plain, _stlsq(rows[:, :-1], rows[:, -1], threshold, ridge))


def ensemble(case: RegressionCase) -> Answer:
    """PySINDy's ensemble of STLSQ on bootstrapped rows, median of the coefficients."""
    from pysindy import STLSQ, EnsembleOptimizer

    seen = case.plain
    _, threshold, ridge = _settings(seen)[0]
    rng = np.random.default_rng(0)
    rows = np.sort(rng.choice(len(seen.e), min(len(seen.e), 4 * ENSEMBLE_ROWS), replace=False))
    norms = np.linalg.norm(seen.X[rows], axis=0)
    X, y = seen.X[rows] / np.where(norms > 0, norms, 1.0), seen.e[rows] / np.linalg.norm(seen.e[rows])
    # pysindy draws its subsets from numpy's global state; it is put back afterwards
    state = np.random.get_state()  # noqa: NPY002
    np.random.seed(0)  # noqa: NPY002
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            each = STLSQ(threshold=threshold, alpha=ridge, max_iter=20)
            size = min(len(rows), ENSEMBLE_ROWS)
            # subsets hold a share of the rows: the ridge and the threshold refer to columns of length one
            grow = np.sqrt(len(rows) / size)
            fitted = EnsembleOptimizer(each, bagging=True, n_models=ENSEMBLE, n_subset=size).fit(
                X * grow, (y * grow)[:, None]
            )
    finally:
        np.random.set_state(state)  # noqa: NPY002
    return _named(case, seen, np.asarray(fitted.coef_)[0])


# -------------------------------------------------------------------- lasso


def _lasso(case: RegressionCase, seen: RegressionData) -> Answer:
    from sklearn.linear_model import LassoLarsIC

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fitted = LassoLarsIC(criterion="bic", fit_intercept=False).fit(seen.X, seen.e)
    return _named(case, seen, np.asarray(fitted.coef_))


def lasso(case: RegressionCase) -> Answer:
    """Lasso along its whole path (LARS), stopped by BIC."""
    return _lasso(case, case.plain)


def lasso_white(case: RegressionCase) -> Answer:
    """The same on residuals whitened by our prediction-error filters."""
    return _lasso(case, case.white)


# -------------------------------------------------------------------- every candidate, compared by a criterion


def _every(case: RegressionCase, seen: RegressionData, price: float) -> Answer:
    """Fit every candidate at every shape, add the best by criterion, and go on until it no longer falls."""
    e, Z, n = seen.e.copy(), seen.Z.copy(), len(seen.e)
    named: list[int] = []
    ties: tuple[str, ...] = ()
    for step in range(FORWARD):
        total = float(e @ e)
        gains: dict[int, tuple[float, Array]] = {}
        for candidate, cols, free in seen.groups:
            if candidate in named:
                continue
            q, r = np.linalg.qr(Z[:, cols])
            keep = np.abs(np.diag(r)) > 1e-6
            a = q[:, keep].T @ e
            change = n * np.log(max(1.0 - float(a @ a) / total, 1e-12)) + price * free
            if candidate not in gains or change < gains[candidate][0]:
                gains[candidate] = (change, q[:, keep])
        best = min(gains, key=lambda c: gains[c][0])
        if gains[best][0] >= 0.0:
            break
        if step == 0:
            near = [c for c in gains if c != best and gains[c][0] - gains[best][0] < DECISIVE_BIC]
            ties = tuple(case.candidates[c].name for c in near)
        q = gains[best][1]
        e = e - q @ (q.T @ e)
        Z = Z - q @ (q.T @ Z)
        named.append(best)
    return Answer(tuple(case.candidates[c].name for c in named), case.held_out(named), bool(named), ties)


def every_aic(case: RegressionCase) -> Answer:
    """Every candidate fitted and compared by AIC, forward, as PEtab-Select does."""
    return _every(case, case.plain, 2.0)


def every_bic(case: RegressionCase) -> Answer:
    """The same by BIC with the number of samples."""
    return _every(case, case.plain, float(np.log(len(case.plain.e))))


def every_bic_white(case: RegressionCase) -> Answer:
    """The same on residuals whitened by our prediction-error filters."""
    return _every(case, case.white, float(np.log(len(case.white.e))))


# -------------------------------------------------------------------- black box


def _features(case: PeerCase, part: str) -> list[Array]:
    """Return place, speed and acceleration of the reference at the residual's instants, for each record.

    The reference is the first input, a place or a speed.
    """
    blocks = case.residual.blocks if part == "identify" else case.held.blocks
    features = []
    for fit, block in zip(case.stage.fits(part), blocks, strict=True):
        record = fit.experiment.record
        reference = record.signals[fit.experiment.inputs[0]]
        if reference.unit in ("m/s", "rad/s"):
            speed = reference.values
            place = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(record.time))])
        else:
            place = reference.values
            speed = np.gradient(place, record.time)
        rate = np.gradient(speed, record.time)
        pick = np.linspace(0, len(place) - 1, len(block)).round().astype(int)
        features.append(np.column_stack([place, speed, rate])[pick])
    return features


def gaussian_process(case: PeerCase) -> Answer:
    """A Gaussian process from the reference's place, speed and acceleration to each output's residual.

    It alarms where its marginal likelihood beats white noise by BIC on any output; it names nothing.
    """
    return _process_of_residual(case, *(np.concatenate(_features(case, p)) for p in ("identify", "validate")))


def residual_process(case: PeerCase) -> Answer:
    """Kennedy and O'Hagan's discrepancy: a Gaussian process of inputs and model's outputs to each output's residual.

    As `gaussian_process`, on a machine whose inputs are any.  The model is calibrated before, not with it.
    """
    return _process_of_residual(case, *(np.concatenate(_drivers(case, p)) for p in ("identify", "validate")))


def _drivers(case: PeerCase, part: str) -> list[Array]:
    """Return inputs and outputs of the calibrated model at the residual's instants, for each record."""
    blocks = case.residual.blocks if part == "identify" else case.held.blocks
    drivers = []
    for fit, block in zip(case.stage.fits(part), blocks, strict=True):
        signals = fit.experiment.record.signals
        values = [np.asarray(signals[n].values) for n in (*fit.experiment.inputs, *case.residual.channels)]
        pick = np.linspace(0, len(values[0]) - 1, len(block)).round().astype(int)
        drivers.append(np.column_stack(values)[pick])
        drivers[-1][:, -block.shape[1] :] -= block
    return drivers


def _process_of_residual(case: PeerCase, train: Array, test: Array) -> Answer:
    """Return what a Gaussian process of some drivers makes of the residual."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    middle, spread = train.mean(axis=0), np.maximum(train.std(axis=0), 1e-300)
    train, test = (train - middle) / spread, (test - middle) / spread
    seen, held = np.concatenate(case.residual.blocks), np.concatenate(case.held.blocks)
    rows = np.random.default_rng(0).choice(len(train), min(GP_POINTS, len(train)), replace=False)
    alarm, left = False, held.copy()
    for c in range(seen.shape[1]):
        size = float(np.std(seen[:, c])) or 1.0
        y = seen[rows, c] / size
        kernel = ConstantKernel(1.0) * RBF(np.ones(train.shape[1])) + WhiteKernel(0.5)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a length scale at its bound: a driver that does not matter
            fitted = GaussianProcessRegressor(kernel, normalize_y=True).fit(train[rows], y)
        white = -0.5 * len(y) * (np.log(2 * np.pi) + 1.0)  # normalised to unit variance
        price = 0.5 * (len(fitted.kernel_.theta) - 1) * np.log(len(y))
        alarm |= bool(fitted.log_marginal_likelihood_value_ - white > price)
        left[:, c] -= size * fitted.predict(test)
    ratio = np.exp(np.mean(np.log(np.std(left, axis=0) / np.std(held, axis=0))))
    return Answer((), float(ratio), alarm)


# -------------------------------------------------------------------- SINDy on the states


def sindy_states(case: PeerCase) -> Answer:
    """PySINDy as its users use it: acceleration of the carriage from speed, torque and a library of terms.

    Speed and torque are what the model has; any other term that STLSQ keeps is something missing.  Place and speed
    are measured on the motor, the acceleration is PySINDy's smoothed derivative.
    """
    from pysindy import STLSQ, PolynomialLibrary, SINDy, SmoothedFiniteDifference

    from discrepancy.rigs.axis_model import LEAD

    trips, drives = [], []
    names: tuple[str, ...] = ()
    for fit in case.stage.fits("identify"):
        record = fit.experiment.record
        v = record.signals["motor.speed"].values * LEAD / (2 * np.pi)
        x, torque = record.signals["carriage.position"].values, record.signals["motor.torque"].values
        names, terms = _terms(x, v, LEAD)
        trips.append(v)
        drives.append(np.column_stack([torque, terms]))
        step = float(np.median(np.diff(record.time)))
    scale_v = float(np.std(np.concatenate(trips)))
    scale_u = np.std(np.concatenate(drives), axis=0)
    scale_u[scale_u == 0] = 1.0
    x_all, u_all = [v[:, None] / scale_v for v in trips], [u / scale_u for u in drives]
    derive = SmoothedFiniteDifference(smoother_kws={"window_length": 31, "polyorder": 3})
    rates = [np.asarray(derive(x, np.arange(len(x)) * step)) for x in x_all]
    size = float(np.std(np.concatenate(rates)))

    def fitted(rows: Sequence[int], threshold: float, ridge: float) -> Array:
        model = SINDy(STLSQ(threshold=threshold, alpha=ridge), PolynomialLibrary(1, include_bias=False))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model.fit(
                [x_all[i] for i in rows], t=step, x_dot=[rates[i] / size for i in rows], u=[u_all[i] for i in rows]
            )
        out: Array = np.asarray(model.coefficients())[0]
        return out

    best = (np.inf, 0.1, 1e-3)
    every = list(range(len(trips)))
    for threshold in THRESHOLDS:
        error = 0.0
        for k in every:
            c = fitted([i for i in every if i != k], threshold, 1e-3)
            error += float(np.sum((rates[k][:, 0] / size - np.column_stack([x_all[k], u_all[k]]) @ c) ** 2))
        best = min(best, (error, threshold, 1e-3))
    kept = fitted(every, best[1], best[2])[2:]
    order = [i for i in np.argsort(-np.abs(kept)) if kept[i] != 0.0]
    return Answer(tuple(dict.fromkeys(names[i] for i in order)), float("nan"), bool(order))


def _terms(x: Array, v: Array, lead: float) -> tuple[tuple[str, ...], Array]:
    fast = max(float(np.quantile(np.abs(v), 0.95)), 1e-12)
    sign = np.tanh(v / (0.01 * fast))
    turn = 2 * np.pi * x / lead
    rows = {
        "coulomb_friction@guide": [sign],
        "constant_force@guide": [np.ones_like(v)],
        "asymmetric_viscous_friction@guide": [np.abs(v)],
        "quadratic_drag@guide": [v * np.abs(v)],
        "stribeck_friction@guide": [sign * np.exp(-((v / (s * fast)) ** 2)) for s in (0.03, 0.08, 0.2, 0.5)],
        "position_dependent_friction@guide": [sign * x, sign * x**2],
        "linear_stiffness@guide": [x],
        "cubic_stiffness@guide": [x**3],
        "angle_harmonic@motor": [f(k * turn) for k in (1, 2, 4, 8) for f in (np.cos, np.sin)],
    }
    names = tuple(n for n, each in rows.items() for _ in each)
    return names, np.column_stack([column for each in rows.values() for column in each])


#: Name in the table → method that needs the regression only.
REGRESSION_METHODS: dict[str, Callable[[RegressionCase], Answer]] = {
    "PySINDy STLSQ, scan's columns": stlsq,
    "PySINDy ensemble STLSQ, scan's columns": ensemble,
    "lasso, BIC": lasso,
    "lasso, BIC, whitened": lasso_white,
    "every candidate, AIC": every_aic,
    "every candidate, BIC": every_bic,
    "every candidate, BIC, whitened": every_bic_white,
}
#: The same and those that need the records.
METHODS: dict[str, Callable[[PeerCase], Answer]] = {
    **REGRESSION_METHODS,
    "PySINDy on states": sindy_states,
    GAUSSIAN_PROCESS: gaussian_process,
}


def methods_on(case: PeerCase) -> dict[str, Callable[[PeerCase], Answer]]:
    """Return the methods that can take a case: regression on states is made for the axis only."""
    axis = {"motor.speed", "carriage.position", "motor.torque"} <= set(case.residual.channels)
    return {n: f for n, f in METHODS.items() if axis or f is not sindy_states}
