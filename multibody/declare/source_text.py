"""The text of source files as it was when their classes were defined.

Equations are read from source text.  A study must not read the new text of a model file that is edited while it runs
under the line numbers of the old one.
"""

from __future__ import annotations

import inspect
import sys
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

from multibody.base.parsing import parse

__all__ = ["function_lines", "remember"]

_texts: dict[str, list[str]] = {}


def remember(module: str) -> None:
    """Store the text of a module's file, once."""
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None or file in _texts:
        return
    try:
        _texts[file] = Path(file).read_text(encoding="utf-8").splitlines(keepends=True)
    except (OSError, UnicodeDecodeError):
        _texts[file] = []


def function_lines(function: Callable[..., Any]) -> tuple[list[str], int]:
    """Return a function's source lines and the number of the first, from the stored text where there is one.

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
    lines = lines[code.co_firstlineno - 1 :]
    return _block(lines) or inspect.getblock(lines), code.co_firstlineno


def _block(lines: list[str]) -> list[str]:
    """Return the lines of the function at the start of some lines, or none where indentation does not show its end.

    To tokenize them, as `inspect` does, takes a tenth of the time in which a model is assembled.
    """
    indent = len(lines[0]) - len(lines[0].lstrip())
    count, headed = 0, False
    for line in lines:
        bare = line.lstrip()
        if bare and not bare.startswith("#") and len(line) - len(bare) <= indent and headed and bare[0] != ")":
            break
        headed = headed or bare.startswith("def ")
        count += 1
    function = lines[:count]
    try:
        tree = parse(textwrap.dedent("".join(function)))
    except SyntaxError:
        return []
    return function[: tree.body[0].end_lineno] if len(tree.body) == 1 else []
