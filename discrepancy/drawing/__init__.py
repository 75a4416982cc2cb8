"""How figures look, and the figure of a comparison: drawn from arrays, without the objects of other rooms.

Takes from no other room of the package.
"""
