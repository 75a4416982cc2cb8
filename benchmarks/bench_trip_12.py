"""A trip of the lift with 12 states, 6 s with 1 kHz output, at equal error (1e-4 of the signals' deviation).

"C by hand" steps over the samples of the measured tension wherever the error allows it. The package's methods end
steps where the signal has motions above a tenth of the tolerance that it does not resolve finely; "no step longer than
a sample" is the same C program with the strict rule.
"""

from __future__ import annotations

from trips import entries

globals().update(entries("cabin"))
