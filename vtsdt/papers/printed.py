"""What the lift's paper prints."""

from __future__ import annotations

__all__ = ["PAPER"]

#: Short name of the paper.
PAPER = "González et al. 2020, A digital twin for operational evaluation of vertical transportation systems"
