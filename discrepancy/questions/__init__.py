"""What else a user asks: how well the model agrees, where it fails, what an unknown force depends on, and what to
measure next.

Takes from `discrepancy.search` and what is below it.
"""
