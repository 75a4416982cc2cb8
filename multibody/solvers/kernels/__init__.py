"""Compiled drivers, to be loaded through `multibody.native.load_driver` and not by import (see there)."""
