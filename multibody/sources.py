"""The text of source files as it was when their classes were made.

Equations are read from source text.  Somebody who edits a model file while a study runs must not have the study see
half of the new text under the line numbers of the old one.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

__all__ = ["function_lines", "remember"]

_texts: dict[str, list[str]] = {}


def remember(module: str) -> None:
    """Keep the text of a module's file, once."""
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None or file in _texts:
        return
    try:
        _texts[file] = Path(file).read_text(encoding="utf-8").splitlines(keepends=True)
    except (OSError, UnicodeDecodeError):
        _texts[file] = []


def function_lines(function: Callable[..., Any]) -> tuple[list[str], int]:
    """Return a function's source lines and the number of the first, from the remembered text where there is one.

    Raises
    ------
    OSError
        If there is no source text.
    """
    code = inspect.unwrap(function).__code__
    remember(function.__module__)
    lines = _texts.get(code.co_filename, [])
    if not lines or code.co_firstlineno > len(lines):
        return inspect.getsourcelines(function)
    return inspect.getblock(lines[code.co_firstlineno - 1 :]), code.co_firstlineno
