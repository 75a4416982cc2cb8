"""What is kept of a record: what it says about the machine, by itself, whatever came before."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

__all__ = ["KINDS", "Judgement", "Quantity"]

#: Kinds of quantities: what a record says of a parameter; how far the model misses an output; a signal that is not
#: measured; what a reader follows, such as an energy; a condition under which the record was taken.
KINDS = ("parameter", "misfit", "virtual", "feature", "condition")


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """A number that a record gives.

    Parameters
    ----------
    value, std : float
        In the unit; an infinite deviation says that the record tells nothing, zero that there is none to state.
    unit : str
    kind : str
        One of `KINDS`.
    """

    value: float
    std: float = 0.0
    unit: str = ""
    kind: str = "feature"

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"the kind of a quantity is '{self.kind}': take one of {', '.join(KINDS)}")


@dataclass(frozen=True, eq=False, kw_only=True)
class Judgement:
    """A judged record.

    Parameters
    ----------
    key : str
        Of its content: the same record is judged once, whatever its name.
    name : str
    at : float, s
        When it was recorded, in seconds since 1970 (UTC).
    duration : float, s
    quantities : mapping of str to Quantity
    checks : mapping
        Predictive checks by output, as in diagnosis.json.
    refused : str
        Why the record could not be judged; empty where it was.
    """

    key: str
    name: str
    at: float
    duration: float = 0.0
    quantities: Mapping[str, Quantity] = field(default_factory=dict)
    checks: Mapping[str, Any] = field(default_factory=dict)
    refused: str = ""
