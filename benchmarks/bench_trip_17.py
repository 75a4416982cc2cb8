"""A trip of the lift with 17 states, 6 s with 1 kHz output, at equal error (1e-4 of the signals' deviation).

The rates take 0.06 µs, so that the work on vectors around them decides: the C program knows the number of states when
it is compiled, and has the rates and the even table of inputs inlined; the package's loop calls the rates by address,
for any model and any times. Stability limits the explicit steps throughout. The default method sees that, tries
sixteen stiff steps, finds that they are not longer by half as much again as what they cost, and goes on: the trial, a
look at the Jacobian and the calls between them are what it takes beyond DormandPrince54. At a tolerance above 3e-4 it
does go stiff, which is faster for the error that was asked for and misses the one that this table asks for.
"""

from __future__ import annotations

from trips import entries

globals().update(entries("one_dimensional"))
