"""Score test, whitening, projection, null distribution and ties: arrays only, nothing of machines.

Takes from `estimation.signals` and `multibody.base`.
"""
