"""How much work an integration may be: so much that every sound one fits, so little that a hopeless one ends soon."""

from __future__ import annotations

__all__ = ["EVALUATIONS_PER_SAMPLE", "LEAST_EVALUATIONS", "too_many"]

LEAST_EVALUATIONS = 2_000_000
"""Evaluations of the equations that every integration may take: seconds, with a model of twenty states."""
EVALUATIONS_PER_SAMPLE = 2000
"""More of them for each sample and each time of an input: steps of a three-hundredth of a sample are followed."""


def too_many(used: int, allowed: int, t: float) -> str:
    """Return the message of an integration that was given up at a time t, s."""
    return (
        f"{used} evaluations of the equations, more than the {allowed} allowed, came only to t = {t:.9g} s: the steps "
        "are very small there. Is something a million times stiffer or faster than the rest: a stiffness, a damping, a "
        "small mass, a time constant, a force that jumps?"
    )
