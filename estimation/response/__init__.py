"""Experiments: the response of a model to the inputs of a record, and its derivatives along any direction.

Takes from `estimation.files`, `estimation.signals` and `multibody`.
"""
