"""Updating a gear stage's model from recordings: ``vtsdt update-gearbox``.

Takes from `gearbox.stage`, `gearbox.signals` and `surrogate`.
"""
