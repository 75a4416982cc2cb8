"""Kalman filters and smoothers for any compiled machine: states, unknown parameters, forces that are not measured.

A :class:`FilterModel` names the measured outputs and the unknowns, :class:`FilterSamples` holds inputs and readings,
:class:`Noise` and :class:`Prior` the covariances; :func:`extended_kalman_filter` and :func:`unscented_kalman_filter`
return a :class:`FilterRun`, whose ``smooth()`` and ``consistency()`` follow; :func:`virtual_sensors` gives outputs that
are not measured, :func:`observability` which states the readings determine.
The public names stand in ``__init__.pyi`` and are imported on first use.  Takes from `multibody`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
