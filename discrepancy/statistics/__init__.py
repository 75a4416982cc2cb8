"""Statistics on arrays: whitening, projection, scores, null distribution, masking pairs, verdicts; nothing of machines.

`scan` in `discrepancy.statistics.scan` scores candidates on a residual; `blocks` has the arrays that it takes.
Takes from `multibody.base` only.
"""
