"""Measured records, and what can be learned from them: calibration, filters, smoothers.

Records: :func:`read_records` reads CSV, Parquet and MATLAB files into :class:`Record`, refuses what is
broken and logs what was done; :class:`Preparation` filters record and model alike;
:mod:`estimation.signals.metrics` says how far they are apart.
"""

from estimation.files.checks import RecordError
from estimation.files.reading import read_record, read_records
from estimation.files.record import ReadRules, Record, Signal
from estimation.signals.preparation import Preparation, SignalError

__all__ = [
    "Preparation",
    "ReadRules",
    "Record",
    "RecordError",
    "Signal",
    "SignalError",
    "read_record",
    "read_records",
]
