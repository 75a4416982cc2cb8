"""Stages: fitted models with their effects, their residuals on records used and held out, and what is computed of them.

`fit_stage.fitted_stage` makes a `stage.Stage`.
Takes from `discrepancy.sensitivities` and the rooms below it.
"""
