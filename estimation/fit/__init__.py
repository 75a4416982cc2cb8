"""Calibration: uncertain parameters fitted to records within their priors, with intervals for coloured residuals.

Import `calibrate` and `evaluate` from `estimation.fit.calibrate`, `UncertainParameter` and `Calibration` from
`estimation.fit.calibration`.
Takes from `estimation.response` and the rooms below it.
"""
