"""The text of source files as it was when their classes were made.

Equations are read from source text.  Somebody who edits a model file while a study runs must not have the study see
half of the new text under the line numbers of the old one.
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
    lines = lines[code.co_firstlineno - 1 :]
    return _block(lines) or inspect.getblock(lines), code.co_firstlineno


def _block(lines: list[str]) -> list[str]:
    """Return the lines of the function that lines begin with, or none where its end takes more than indentation to see.

    To go through them token by token, as `inspect` does, takes a tenth of what a model takes to be put together.
    """
    indent = len(lines[0]) - len(lines[0].lstrip())
    count, headed = 0, False
    for line in lines:
        bare = line.lstrip()
        if bare and not bare.startswith("#") and len(line) - len(bare) <= indent and headed and bare[0] != ")":
            break
        headed = headed or bare.startswith("def ")
        count += 1
    found = lines[:count]
    try:
        tree = parse(textwrap.dedent("".join(found)))
    except SyntaxError:
        return []
    return found[: tree.body[0].end_lineno] if len(tree.body) == 1 else []
