"""Vibration signals of a gear stage: preparation, spectra, mesh lines, orders, similarity, recordings, figures.

All rooms above may import from here.  Takes from `gearbox.files`, `estimation` and `discrepancy.drawing`.
"""
