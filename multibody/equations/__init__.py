"""Equations as text: the subset of Python, its statements, exact differentiation, tables.

Takes from `multibody.base` and `multibody.declare`.
"""
