"""Measured records, and what is learned from them: experiments, calibration, Kalman filters and smoothers.

:func:`read_records` reads files of many formats into :class:`Record`; :class:`Preparation` filters record and
model alike; an :class:`Experiment` simulates a record, :func:`calibrate` fits uncertain parameters to experiments;
:mod:`estimation.filters` estimates states, and :mod:`estimation.signals.metrics` compares signals.
The public names stand in ``__init__.pyi`` and are imported on first use.  Takes from `multibody`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
