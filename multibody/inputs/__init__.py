"""Inputs over time as a table, and the instants at which a step has to end for them.

Takes from nobody.
"""
