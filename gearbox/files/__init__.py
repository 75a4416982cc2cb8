"""The numbers of a gear stage in files, the geometry that follows from them, operating conditions, and `GearError`.

All other rooms may import from here.  Takes from `multibody.base` and `estimation.signals`.
"""
