"""What stands where a file should be, and what to do: nothing, a folder, a link to nothing, a pipe."""

from __future__ import annotations

import os
from pathlib import Path

from multibody.base.spelling import nearest_or_choices

__all__ = ["why_no_file"]


def why_no_file(path: Path, *, ending: str = "", what: str = "file") -> str:
    """Return why a path is no file that can be read, with what to do; an empty text where it is one.

    Parameters
    ----------
    path : Path
    ending : str
        Of the files beside it that could be meant; default: any.
    what : str
        Word for what is looked for.
    """
    if path.is_file():
        return ""
    if path.is_dir():
        return f"is a folder: name the {what} in it"
    if path.is_symlink():
        return f"is a link to '{os.readlink(path)}', which is not there: mend the link, or name the {what} itself"
    if path.exists():
        return f"is a pipe or a device: write what it gives into a {what} and name that"
    siblings: list[str] = []
    if path.parent.is_dir():
        siblings = sorted(p.name for p in path.parent.iterdir() if p.name.endswith(ending) and p.is_file())
    if not siblings:
        nothing = "has none" if ending else "empty"
        return f"there is no such {what}; its folder is missing or {nothing}: name one that is there"
    return f"there is no such {what}{nearest_or_choices(path.name, siblings)}"
