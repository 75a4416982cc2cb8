"""Free fall where nothing else is stated."""

from __future__ import annotations

__all__ = ["STANDARD_GRAVITY"]

#: Acceleration of free fall by definition (3rd General Conference on Weights and Measures, 1901), m/s².
STANDARD_GRAVITY = 9.80665
