"""How figures and pages look, and the figure of a comparison: from arrays, without the objects of other rooms.

Takes from no other room of the package.
"""
