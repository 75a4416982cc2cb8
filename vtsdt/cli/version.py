"""The installed version."""

from importlib.metadata import PackageNotFoundError, version

__all__ = ["__version__"]

try:
    __version__ = version("vtsdt")
except PackageNotFoundError:  # a source tree on the path that was never installed
    __version__ = "0+unknown"
