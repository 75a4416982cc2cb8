"""How often the search is right: suites of virtual machines, other methods on the same data, error rates.

Takes from every other room.
"""
