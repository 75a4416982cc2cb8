"""Python source text as a syntax tree, from any thread."""

from __future__ import annotations

import ast
import threading

__all__ = ["expression", "parse"]

_lock = threading.Lock()


def parse(text: str) -> ast.Module:
    """Return a text's syntax tree; one thread at a time.

    Python 3.11 counts how deep it is in the trees of all threads together, and fails if two build trees at once:
    "AST constructor recursion depth mismatch".

    Examples
    --------
    >>> ast.unparse(parse("x  =  1"))
    'x = 1'
    """
    with _lock:
        return ast.parse(text)


def expression(text: str) -> ast.expr:
    """Return the syntax tree of a single expression; otherwise as `parse`."""
    with _lock:
        return ast.parse(text, mode="eval").body
