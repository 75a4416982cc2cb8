"""The gear stage's components: contact, mesh, bearings, shafts, housing.

Takes from `multibody`.
"""
