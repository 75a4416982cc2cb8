"""The numbers of a gear stage in files, the geometry that follows from them, and errors.

Takes from `multibody.base`.
"""
