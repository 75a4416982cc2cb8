"""Equations as text: the subset of Python, its statements, exact differentiation, tables.

To import from here: `method_statements`, `Statement`, `Differentiator` and the kernels of tables.  Takes from
`multibody.base` and `multibody.declare`.
"""
