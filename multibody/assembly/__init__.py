"""From a model's graph to its equations: kinematics, Newton's law, order of evaluation.

Takes from the model and from what is below it.
"""
