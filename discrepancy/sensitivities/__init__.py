"""Sensitivities of the outputs of a fitted model to its parameters, to candidate effects, and to unknown forces.

All of them start from a `linearised_problem.LinearisedProblem`.
Takes from `discrepancy.residual` and the rooms below it.
"""
