"""What a model says that the sensors read, and how that changes with anything.

Takes from `estimation.files`, `estimation.signals` and `multibody`.
"""
