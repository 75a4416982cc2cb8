"""Machine code from a small subset of Python: scalars, pointers, tuples as results, `math`, if, for, while.

Equations and integrators are written in this subset (DESIGN, decision 4).  Here its text becomes LLVM's language
directly, which takes a tenth of the time that a compiler for all of Python needs for the same text; what the
subset lacks goes to numba (see `multibody.compile.native`).
"""
