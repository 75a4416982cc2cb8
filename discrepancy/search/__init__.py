"""The search for missing effects: moves, model comparison, decisions.

Takes from `discrepancy.sensitivities` and what is below it.
"""
