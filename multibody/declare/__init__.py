"""The base class of components, their declarations, and the checks of both.

To import from here: `Component` and the declarations (`Parameter`, `State`, `Translation`, …).  Takes from
`multibody.base`.
"""
