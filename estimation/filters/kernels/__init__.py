"""Compiled loops of the filters, to be loaded through `multibody.compile.native.load_driver` and not by import."""
