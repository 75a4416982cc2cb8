"""Libraries that read one format each and are installed only by those who need them."""

from __future__ import annotations

import importlib
import warnings
from pathlib import Path
from typing import Any

from estimation.files.faults import RecordError

__all__ = ["library"]


def library(module: str, path: Path, what: str, extra: str) -> Any:
    """Import a library that reads a file.

    Parameters
    ----------
    module : str
        Its name in Python.
    path : Path
        The file, for the message.
    what : str
        What the file is, such as ``"an MDF file"``.
    extra : str
        The extra of the package that installs the library.

    Raises
    ------
    RecordError
        If it is not installed.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of settings that the library changes or no longer needs
            return importlib.import_module(module)
    except ImportError as error:
        raise RecordError(
            [
                f"{path.name}: is {what}, which needs the library {module.partition('.')[0]}: install it with "
                f"pip install 'vtsdt[{extra}]' (vtsdt[readers] for every format)"
            ]
        ) from error
