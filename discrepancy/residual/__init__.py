"""How a model is confronted with a record: simulation, windows, inverse; noisy inputs.

Takes from `discrepancy.problem` and what is below it.
"""
