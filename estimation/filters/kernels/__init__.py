"""Compiled loops of the filters, over bare pointers; imported by `estimation.filters` only.

Takes from `multibody.compile` and `multibody.solvers.kernels`.
"""
