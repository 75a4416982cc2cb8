"""Inputs over time as a table, and the instants at which a step has to end because of them.

To import from here: `InputTable` and `InputError`.  Takes from no other room.
"""
