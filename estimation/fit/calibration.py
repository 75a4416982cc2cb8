"""Uncertain parameters, and the result of a calibration: values, every record's own unknowns, intervals, remarks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from estimation.fit.least_squares import AT_LIMIT
from estimation.response.experiment import Experiment, Response

if TYPE_CHECKING:
    import pandas

__all__ = ["Calibration", "Fit", "UncertainParameter"]


@dataclass(frozen=True, kw_only=True)
class UncertainParameter:
    """A parameter that calibration may fit.

    Parameters
    ----------
    name : str
        Model parameter, or ``sensor.<output>.<offset|gain|drift|delay>``.
    value : float
        Start value and mean of its prior, SI.
    std : float
        Standard deviation of its prior; infinite without one.
    min, max : float
        Bounds.
    unit : str
    """

    name: str
    value: float
    std: float = np.inf
    min: float = -np.inf
    max: float = np.inf
    unit: str = ""


@dataclass(frozen=True, eq=False)
class Fit:
    """One experiment at the fitted parameters.

    Parameters
    ----------
    experiment : Experiment
    response : Response
        Outputs, and derivatives by the parameters and then by this record's own unknowns.
    own : dict of str to float
        Start values and sensor offsets of this record.
    """

    experiment: Experiment
    response: Response
    own: dict[str, float]

    @property
    def residual(self) -> np.ndarray:
        """Measured minus modelled, shape (n, n_channels)."""
        return self.experiment.measured - self.response.outputs


@dataclass(frozen=True, eq=False, kw_only=True)
class Calibration:
    """The result of a calibration.

    Parameters
    ----------
    parameters : tuple of UncertainParameter
        The fitted parameters; those that the records do not excite keep their start values.
    values, std : ndarray, shape (k,)
        Fitted values and standard deviations (block sandwich: they hold for coloured residuals).  The deviation is
        infinite for parameters that ended at a bound or were not excited, because the records do not determine it.
    degrees : int
        Degrees of freedom of the intervals (Student's t).
    fits : tuple of Fit
        Every experiment at the fitted values.
    scale : dict of str to float
        Standard deviation by which each output's residual was divided.
    not_excited : tuple of str
        Parameters without influence on any output of these records.
    at_bound : tuple of str
        Parameters that ended at a bound.
    confounded : tuple of tuple of str
        Groups of parameters whose effects the records cannot distinguish.
    message : str
        How the optimisation ended.
    """

    parameters: tuple[UncertainParameter, ...]
    values: np.ndarray
    std: np.ndarray
    degrees: int
    fits: tuple[Fit, ...]
    scale: dict[str, float]
    not_excited: tuple[str, ...] = ()
    at_bound: tuple[str, ...] = ()
    confounded: tuple[tuple[str, ...], ...] = ()
    message: str = ""
    evaluations: int = 0

    @property
    def own_values(self) -> list[np.ndarray]:
        """What is unknown of each record, such as its initial states, at the fitted values; one array for each."""
        return [np.array(list(f.own.values())) for f in self.fits]

    @property
    def stopped_early(self) -> bool:
        """Whether the fit was stopped at its limit of simulations, before its end."""
        return self.message == AT_LIMIT

    def __getitem__(self, name: str) -> float:
        for parameter, value in zip(self.parameters, self.values, strict=True):
            if parameter.name == name:
                return float(value)
        raise KeyError(f"'{name}' was not calibrated; calibrated: {', '.join(p.name for p in self.parameters)}")

    def std_of(self, name: str) -> float:
        """Return the standard deviation of a parameter."""
        return float(self.std[[p.name for p in self.parameters].index(name)])

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Return the confidence interval of a parameter."""
        from scipy.stats import t

        half = float(t.ppf(0.5 + level / 2, self.degrees)) * self.std_of(name)
        return self[name] - half, self[name] + half

    def to_dict(self) -> dict[str, float]:
        """Return the values by name."""
        return {p.name: float(v) for p, v in zip(self.parameters, self.values, strict=True)}

    def to_frame(self) -> pandas.DataFrame:
        """Return a table: start, value, standard deviation, unit and remarks."""
        import pandas

        rows = []
        for p, v, s in zip(self.parameters, self.values, self.std, strict=True):
            remarks = [
                w
                for w, names in (("not excited", self.not_excited), ("at its bound", self.at_bound))
                if p.name in names
            ]
            remarks += [
                f"confounded with {', '.join(n for n in g if n != p.name)}" for g in self.confounded if p.name in g
            ]
            rows.append((p.value, v, s, p.unit, "; ".join(remarks)))
        return pandas.DataFrame(
            rows,
            columns=["start", "value", "std", "unit", "remark"],
            index=pandas.Index([p.name for p in self.parameters], name="parameter"),
        )

    def __repr__(self) -> str:
        values = ", ".join(
            f"{p.name} = {v:.4g} ± {s:.2g} {p.unit}".rstrip()
            for p, v, s in zip(self.parameters, self.values, self.std, strict=True)
        )
        return f"Calibration({values or 'nothing to fit'})"
