"""Vibration signals of a gear stage: preparation, spectra, lines, similarity, recordings.

Takes from `estimation`.
"""
