"""The study: the front door of the package, from a study file to a conclusion.

Takes from every other room but the rigs and the validation.
"""
