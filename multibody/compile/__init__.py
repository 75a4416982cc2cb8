"""From assembled equations to machine code: generated source, numba, vector lanes, C text.

Takes from `multibody.assembly` and what is below it.
"""
