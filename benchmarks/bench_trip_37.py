"""A trip of the lift with 37 states, 6 s with 1 kHz output, at equal error (1e-4 of the signals' deviation).

SciPy's methods and CVODE call rates and Jacobian with the inputs in them, one compiled call each, and SciPy's end their
steps where the package's do. What they take is Python: some 3 µs for each of up to 30 000 evaluations, 0.1 to 0.4 ms of
their own for each of 500 to 4000 steps, and 0.1 to 0.3 s for the 6001 samples.
"""

from __future__ import annotations

from trips import entries

globals().update(entries("reference"))
