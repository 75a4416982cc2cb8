"""The likelihood of a residual in innovation form: sensor noise and latent forces, whitened by a Kalman filter.

May be imported: every module.  It takes from `multibody` and `estimation` and knows nothing of effects.
"""
