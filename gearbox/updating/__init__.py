"""Updating a gear stage's model from recordings, section 3.4 of the gearbox paper: ``vtsdt update-gearbox``.

Users import `update` and `UpdatingChain`.  Takes from `gearbox.signals`, `surrogate` and `discrepancy.problem`.
"""
