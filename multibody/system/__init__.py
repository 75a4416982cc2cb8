"""A compiled machine and what is done with it: simulation, equilibrium, linearisation.

The top of `multibody`: takes from every other room but the library.
"""
