"""Progress that nobody asked to see."""

from __future__ import annotations

__all__ = ["silent"]


def silent(text: str) -> None:
    """Swallow a line of progress."""
