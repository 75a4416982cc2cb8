"""Machine code from a small subset of Python: scalars, pointers, tuples as results, `math`, if, for, while.

Kernels of solvers and filters, and equations in SIMD lanes, become LLVM's language here; equations one by one go
through numba (`multibody.compile.native`).  Equations are written in the same subset, so that either takes them.
"""
