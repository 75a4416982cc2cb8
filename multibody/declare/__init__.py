"""What a component declares beside its equations, and the checks of it.

Here are `Component` and the declarations (`Parameter`, `State`, `Translation`, …).  Takes from `multibody.base`.
"""
