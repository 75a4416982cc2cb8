"""A trip of the lift with 17 states, 6 s with 1 kHz output, at equal error (1e-4 of the signals' deviation).

The rates take 0.06 µs, so that the work on vectors around them decides: the C program knows the number of states when
it is compiled, and has the rates and the even table of inputs inlined; the package's loop calls the rates by address,
for any model and any times. "Where the time of a 17-state trip goes" has the shares. Stability limits the explicit
steps throughout. The default method sees that, tries eight or sixteen stiff steps, finds that they are not longer by
half as much again as what they cost, and goes on: the trial, the preparation of the stiff method and, at rtol 0.0003, a
twentieth more steps are what it takes beyond DormandPrince54. At rtol 0.003 and above it does go stiff, which is
faster for the error that was asked for and misses the one that this table asks for.
"""

from __future__ import annotations

from trips import entries

globals().update(entries("one_dimensional"))
