"""Compiled drivers, to be loaded through `multibody.compile.native.load_driver` and not by import (see there)."""
