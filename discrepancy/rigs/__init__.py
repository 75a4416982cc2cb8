"""Virtual machines that write recordings, with effects hidden in them.

Takes from `discrepancy.effects` and `discrepancy.problem`.
"""
