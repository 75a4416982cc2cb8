"""The search for missing effects: its state, the moves, the model comparison that decides, its numbers, and the loop.

Takes from `discrepancy.sensitivities` and what is below it.
"""
