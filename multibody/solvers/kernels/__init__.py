"""Compiled loops of the solvers, and what they read of a problem."""
