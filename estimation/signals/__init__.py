"""Preparing signals (window, low-pass, decimation) and measuring how far two of them are apart.

Takes from nobody.
"""
