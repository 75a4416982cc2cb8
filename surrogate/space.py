"""The parameters of a design: names, units, bounds, and the min–max scaling between them and [0, 1]."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["DesignSpace", "SurrogateWarning"]

Array = NDArray[np.float64]

#: Points are accepted this far outside [0, 1] after scaling: the rounding of scaling there and back.
ROUNDING = 1e-9


class SurrogateWarning(UserWarning):
    """A result is usable, but less reliable than it may look."""


@dataclass(frozen=True)
class DesignSpace:
    """Named parameters with units and bounds.

    Parameters
    ----------
    names : sequence of str
        Names of the k parameters, all different.
    units : sequence of str
        Their units, ``""`` where dimensionless.
    lower, upper : sequence of float
        Their bounds in those units, ``lower < upper``.

    Raises
    ------
    ValueError
        With every fault of the declaration in one message.

    Examples
    --------
    >>> space = DesignSpace(("K", "e_F"), ("N/mm^1.5", ""), (4.3e5, 1.5), (12.9e5, 2.5))
    >>> space.to_unit([[8.6e5, 2.0]])
    array([[0.5, 0.5]])
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]

    def __post_init__(self) -> None:
        for field in ("names", "units"):
            value = getattr(self, field)
            if isinstance(value, str):
                raise ValueError(f"'{field}' must be a sequence of strings, not the single string '{value}'")
            object.__setattr__(self, field, tuple(str(item) for item in value))
        faults: list[str] = []
        for field in ("lower", "upper"):
            try:
                bounds = tuple(float(item) for item in getattr(self, field))
            except (TypeError, ValueError) as error:
                raise ValueError(f"'{field}' must be a sequence of numbers ({error})") from error
            object.__setattr__(self, field, bounds)
        k = len(self.names)
        if k == 0:
            faults.append("a design space needs at least one parameter")
        for field in ("units", "lower", "upper"):
            if len(getattr(self, field)) != k:
                faults.append(f"'{field}' has {len(getattr(self, field))} entries for {k} names")
        repeated = sorted({name for name in self.names if self.names.count(name) > 1})
        if repeated:
            faults.append(f"names must differ; repeated: {', '.join(repeated)}")
        if not faults:
            for name, low, high in zip(self.names, self.lower, self.upper, strict=True):
                if not (np.isfinite(low) and np.isfinite(high)):
                    faults.append(f"bounds of '{name}' must be finite numbers, not [{low:g}, {high:g}]")
                elif not low < high:
                    faults.append(f"bounds of '{name}' must be lower < upper, not [{low:g}, {high:g}]")
        if faults:
            raise ValueError("; ".join(faults))

    @classmethod
    def from_mapping(cls, bounds: Mapping[str, Sequence[Any]]) -> DesignSpace:
        """Build from ``{name: (lower, upper)}`` or ``{name: (lower, upper, unit)}``."""
        wrong = [name for name, entry in bounds.items() if len(entry) not in (2, 3)]
        if wrong:
            raise ValueError(f"give (lower, upper) or (lower, upper, unit) for {', '.join(wrong)}")
        return cls(
            tuple(bounds),
            tuple(str(entry[2]) if len(entry) == 3 else "" for entry in bounds.values()),
            tuple(entry[0] for entry in bounds.values()),
            tuple(entry[1] for entry in bounds.values()),
        )

    @classmethod
    def unit_cube(cls, names: Sequence[str]) -> DesignSpace:
        """Dimensionless parameters on [0, 1], as in the paper's Eq. 20."""
        k = len(names)
        return cls(tuple(names), ("",) * k, (0.0,) * k, (1.0,) * k)

    def __len__(self) -> int:
        return len(self.names)

    def __repr__(self) -> str:
        parts = ", ".join(
            f"{name} [{low:g}, {high:g}]{' ' + unit if unit else ''}"
            for name, unit, low, high in zip(self.names, self.units, self.lower, self.upper, strict=True)
        )
        return f"DesignSpace({parts})"

    def subset(self, names: Sequence[str]) -> DesignSpace:
        """The space of some of the parameters, in the order given."""
        unknown = [name for name in names if name not in self.names]
        if unknown:
            raise ValueError(f"no parameter {', '.join(unknown)}; the space has {', '.join(self.names)}")
        index = [self.names.index(name) for name in names]
        return DesignSpace(
            tuple(names),
            tuple(self.units[i] for i in index),
            tuple(self.lower[i] for i in index),
            tuple(self.upper[i] for i in index),
        )

    def points(self, points: ArrayLike, *, inside: bool = True, what: str = "points") -> Array:
        """Check points in the parameters' units and return them with shape (n, k).

        Raises
        ------
        ValueError
            If the number of columns is wrong, or a value is not finite or (with ``inside``) out of bounds;
            the message names rows and parameters.
        """
        x = np.asarray(points, dtype=float)
        if x.ndim == 1 and x.size == len(self):
            x = x[None, :]
        if x.ndim != 2 or x.shape[1] != len(self):
            raise ValueError(
                f"{what} have shape {x.shape}; expected (n, {len(self)}): one column for each of "
                f"{', '.join(self.names)}"
            )
        if not np.isfinite(x).all():
            raise ValueError(f"{what} are not finite: {self._name_entries(x, ~np.isfinite(x))}")
        if inside:
            t = self._scale(x)
            outside = (t < -ROUNDING) | (t > 1.0 + ROUNDING)
            if outside.any():
                raise ValueError(f"{what} lie outside the bounds: {self._name_entries(x, outside)}; {self!r}")
        return x

    def to_unit(self, points: ArrayLike, *, inside: bool = True) -> Array:
        """Scale points, shape (n, k) in the parameters' units, to [0, 1]."""
        t = self._scale(self.points(points, inside=inside))
        return np.clip(t, 0.0, 1.0) if inside else t

    def from_unit(self, points: ArrayLike) -> Array:
        """Scale points on [0, 1], shape (n, k) or (k,), back to the parameters' units (same shape)."""
        t = np.asarray(points, dtype=float)
        if t.ndim == 0 or t.shape[-1] != len(self):
            raise ValueError(f"scaled points have shape {t.shape}; the last axis must have {len(self)} entries")
        low, span = np.array(self.lower), self.span
        # Exact at both ends, which low + span * t is not.
        return np.where(t == 1.0, np.array(self.upper), low + span * t)

    @property
    def span(self) -> Array:
        """Width of each parameter's range, shape (k,), in its unit."""
        return np.array(self.upper) - np.array(self.lower)

    def labels(self) -> tuple[str, ...]:
        """Names with units in brackets, as written on axes and in column heads."""
        return tuple(f"{n} [{u}]" if u else n for n, u in zip(self.names, self.units, strict=True))

    def to_frame(self, points: ArrayLike | None = None) -> pd.DataFrame:
        """Table of the parameters, or of given points with one column for each parameter."""
        import pandas as pd

        if points is not None:
            return pd.DataFrame(self.points(points, inside=False), columns=list(self.labels()))
        return pd.DataFrame(
            {"unit": self.units, "lower": self.lower, "upper": self.upper},
            index=pd.Index(self.names, name="parameter"),
        )

    def to_dict(self) -> dict[str, list[Any]]:
        """Plain lists, for JSON."""
        return {
            "names": list(self.names),
            "units": list(self.units),
            "lower": list(self.lower),
            "upper": list(self.upper),
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> DesignSpace:
        """Read what :meth:`to_dict` wrote."""
        missing = [key for key in ("names", "units", "lower", "upper") if key not in content]
        if missing:
            raise ValueError(f"the description of the design space lacks {', '.join(missing)}")
        return cls(content["names"], content["units"], content["lower"], content["upper"])

    def _scale(self, x: Array) -> Array:
        return (x - np.array(self.lower)) / self.span

    def _name_entries(self, x: Array, wrong: NDArray[np.bool_], limit: int = 8) -> str:
        places = np.argwhere(wrong)
        text = ", ".join(f"row {r} {self.names[c]} = {x[r, c]:.6g}" for r, c in places[:limit])
        more = len(places) - limit
        return text + (f" and {more} more" if more > 0 else "")
