"""What the gearbox paper prints."""

from __future__ import annotations

__all__ = ["PAPER"]

#: Short name of the paper.
PAPER = "Digital twin-assisted gearbox dynamic model updating"
