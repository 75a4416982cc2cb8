"""How each parameter and each candidate effect moves the outputs of a fitted model.

Takes from `discrepancy.stages` and what is below it.
"""
