"""Compiled loops of the filters, to be loaded through `multibody.native.load_driver` and not by import."""
