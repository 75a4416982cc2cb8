"""Polynomial terms, their values and their derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, permutations
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["Terms", "polynomial_terms"]

Array = NDArray[np.float64]
TermSet = Literal["paper", "full", "eq11"]
TERM_SETS = ("paper", "full", "eq11")


@dataclass(frozen=True)
class Terms:
    """Monomials in k variables.

    Parameters
    ----------
    exponents : tuple of tuple of int, shape (p, k)
        Power of each variable in each term.
    """

    exponents: tuple[tuple[int, ...], ...]

    def __post_init__(self) -> None:
        rows = tuple(tuple(int(e) for e in row) for row in self.exponents)
        object.__setattr__(self, "exponents", rows)
        if not rows or len({len(row) for row in rows}) != 1:
            raise ValueError("a polynomial needs at least one term, and one exponent per variable in each term")
        if any(e < 0 for row in rows for e in row):
            raise ValueError("exponents must be whole numbers of at least 0")
        if len(set(rows)) != len(rows):
            raise ValueError("the same term is listed twice")

    def __len__(self) -> int:
        return len(self.exponents)

    @property
    def variables(self) -> int:
        """Number of variables k."""
        return len(self.exponents[0])

    @property
    def order(self) -> int:
        """Highest total degree."""
        return max(sum(row) for row in self.exponents)

    def names(self, variables: Sequence[str]) -> tuple[str, ...]:
        """The terms in words, such as ``K^2*e_F``."""
        if len(variables) != self.variables:
            raise ValueError(f"{len(variables)} names for {self.variables} variables")
        named = []
        for row in self.exponents:
            factors = [v if e == 1 else f"{v}^{e}" for v, e in zip(variables, row, strict=True) if e]
            named.append("*".join(factors) if factors else "1")
        return tuple(named)

    def values(self, t: Array) -> Array:
        """Terms at points: shape (n, k) → (n, p)."""
        return _product(t, np.array(self.exponents))

    def gradient(self, t: Array) -> Array:
        """Derivatives of the terms: shape (n, k) → (n, p, k)."""
        return np.stack([self._derivative(t, (i,)) for i in range(self.variables)], axis=-1)

    def hessian(self, t: Array) -> Array:
        """Second derivatives of the terms: shape (n, k) → (n, p, k, k)."""
        k = self.variables
        rows = [np.stack([self._derivative(t, (i, j)) for j in range(k)], axis=-1) for i in range(k)]
        return np.stack(rows, axis=-2)

    def _derivative(self, t: Array, variables: tuple[int, ...]) -> Array:
        powers = np.array(self.exponents)
        factor = np.ones(len(self))
        for i in variables:
            factor *= powers[:, i]
            powers[:, i] = np.maximum(powers[:, i] - 1, 0)
        return factor * _product(t, powers)


def _product(t: Array, powers: NDArray[Any]) -> Array:
    table = [np.ones_like(t)]
    for _ in range(int(powers.max(initial=0))):
        table.append(table[-1] * t)
    stacked = np.stack(table)
    result = np.ones((t.shape[0], powers.shape[0]))
    for i in range(t.shape[1]):
        result *= stacked[powers[:, i], :, i].T
    return result


def polynomial_terms(variables: int, order: int, kind: TermSet = "paper") -> Terms:
    """The terms of a response surface.

    Parameters
    ----------
    variables : int
        Number of parameters k.
    order : {1, 2, 3}
        Highest degree.
    kind : {"paper", "full", "eq11"}
        For order 3: ``"paper"`` has the cubes and both mixed squares t_i² t_j and t_i t_j², as Eq. 18 of the
        gearbox paper (19 coefficients for k = 3); ``"full"`` adds the products of three different parameters;
        ``"eq11"`` has only t_i t_j² with i > j, as Eq. 11 is printed. Orders 1 and 2 are the same in all.

    Returns
    -------
    Terms
        In the order of Eq. 18: constant, linear, squares, products, cubes, mixed squares, triple products.
    """
    k = int(variables)
    if k < 1:
        raise ValueError(f"a polynomial needs at least one variable, not {variables}")
    if order not in (1, 2, 3):
        raise ValueError(f"order must be 1, 2 or 3, not {order}")
    if kind not in TERM_SETS:
        raise ValueError(f"unknown set of terms '{kind}'; choose one of {', '.join(TERM_SETS)}")

    def term(powers: dict[int, int]) -> tuple[int, ...]:
        return tuple(powers.get(i, 0) for i in range(k))

    rows = [term({})] + [term({i: 1}) for i in range(k)]
    if order >= 2:
        rows += [term({i: 2}) for i in range(k)]
        rows += [term({i: 1, j: 1}) for i, j in combinations(range(k), 2)]
    if order >= 3:
        rows += [term({i: 3}) for i in range(k)]
        pairs = list(permutations(range(k), 2))
        if kind == "eq11":
            pairs = [(i, j) for i, j in pairs if i < j]
        rows += [term({i: 2, j: 1}) for i, j in pairs]
        if kind == "full":
            rows += [term({i: 1, j: 1, h: 1}) for i, j, h in combinations(range(k), 3)]
    return Terms(tuple(rows))
