"""Calibration: uncertain parameters moved within their priors until the model follows the records.

Takes from `estimation.response` and what is below it.
"""
