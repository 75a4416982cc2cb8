"""A trip of the lift with 17 states, 6 s with 1 kHz output, at equal error (1e-4 of the signals' deviation).

The rates take 0.06 µs, so that the work on vectors around them decides: the C program knows the number of states when
it is compiled, and has the rates and the even table of inputs inlined; the package's loop calls the rates by address,
for any model and any times.
"""

from __future__ import annotations

from trips import entries

globals().update(entries("one_dimensional"))
