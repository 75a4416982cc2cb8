"""The gear stage's components: tooth contact and its laws, mesh, bearings, shafts, housing and its modes.

`gearbox.stage` puts them together.  Takes from `gearbox.files` and `multibody`.
"""
