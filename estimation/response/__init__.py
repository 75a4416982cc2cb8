"""Experiments: the response of a model to the inputs of a record, and its derivatives along any direction.

Import `Experiment` from `estimation.response.experiment`, `SensorError` from `estimation.response.sensors`, and
perturbations of inputs and parameters from `estimation.response.perturbations`.
Takes from `estimation.files`, `estimation.signals` and `multibody`.
"""
