"""A machine as a named graph of components, its description, and its file.

Takes from `multibody.base`, `multibody.declare` and `multibody.equations`.
"""
