"""The gear stage as a model, how it is run, and what may be wrong with it.

Takes from `gearbox.parts` and `gearbox.files`.
"""
