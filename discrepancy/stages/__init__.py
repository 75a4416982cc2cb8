"""One fitted model: its effects, its fit, and its residuals on records used and held out.

Takes from `discrepancy.residual` and what is below it.
"""
