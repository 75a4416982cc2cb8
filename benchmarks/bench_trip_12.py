"""A trip of the lift with 12 states, 6 s with 1 kHz output, at equal error (1e-4 of the signals' deviation).

"C by hand" steps over the samples of the measured tension wherever the error allows it. The package's methods end steps
where the signal has motions above a tenth of the tolerance that it does not resolve finely: 159 times at rtol 0.01.
"Steps end where the package's do" is the same C program with that rule, "no step longer than a sample" with the strict
one. What is left is the call, which is a fifth of a trip as short as this: "Where the time of a 12-state trip goes" has
the shares.
"""

from __future__ import annotations

from trips import entries

globals().update(entries("cabin"))
