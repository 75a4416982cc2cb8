"""A compiled machine and its analyses as functions: simulation, equilibrium, linearisation, trajectories.

Takes from every room below.  The classes that carry these functions as methods are in `multibody.machine`.
"""
