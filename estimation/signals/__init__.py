"""Signals: preparation (window, low-pass, decimation), measures of error and noise, correlation times.

Import `Preparation` from `estimation.signals.preparation`, measures from `estimation.signals.metrics`.
Takes from nobody.
"""
