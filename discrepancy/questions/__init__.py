"""Questions about a fitted model: agreement, where it fails, what an unknown force depends on, what to measure next.

Takes from `discrepancy.search` and what is below it.
"""
