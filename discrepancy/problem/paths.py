"""Finding the recordings that a study names, and keeping the held-out ones apart."""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from multibody.base.missing_file import why_no_file

__all__ = ["find_files", "held_out_faults"]


_WITH_DEFAULT = re.compile(r"\$\{(\w+):-([^}]*)\}")


def _value(match: re.Match[str]) -> str:
    """Return a variable's value; as in a shell, an empty one counts as not set."""
    return os.environ.get(match[1]) or match[2]


@dataclass(frozen=True)
class FoundFiles:
    """Files behind a list of names and patterns, with what was wrong on the way."""

    paths: tuple[Path, ...]
    faults: tuple[str, ...]
    warnings: tuple[str, ...]


def find_files(folder: Path, patterns: Sequence[str]) -> FoundFiles:
    """Resolve names and glob patterns; matches of a pattern come in the order of their names.

    Parameters
    ----------
    folder : Path
        Where relative names start.
    patterns : sequence of str
        ``~``, ``$VARIABLE`` and ``${VARIABLE:-value if it is not set}`` are replaced; ``**`` matches folders.
    """
    paths: dict[Path, None] = {}
    faults: list[str] = []
    warnings: list[str] = []
    for pattern in patterns:
        full = os.path.expanduser(os.path.expandvars(_WITH_DEFAULT.sub(_value, pattern)))
        if unset := re.search(r"\$\{?(\w+)", full):
            faults.append(
                f"'{pattern}': the environment variable {unset[1]} is not set: set it, or write "
                f"${{{unset[1]}:-a folder}}"
            )
            continue
        place = folder / full
        if place.is_file():
            matches = [place]
        elif place.is_dir():
            matches = []
            faults.append(f"'{pattern}' is a folder: use a pattern such as '{pattern.rstrip('/')}/*.csv'")
        elif glob.has_magic(full):
            names = sorted(glob.glob(str(place), recursive=True))
            matches = [Path(name) for name in names if Path(name).is_file()]
            if not matches:
                faults.append(f"no file matches the pattern '{pattern}': check its folder and ending")
        else:
            matches = []
            faults.append(f"'{pattern}': {why_no_file(place)}")
        for match in matches:
            plain = Path(os.path.normpath(match))
            if plain in paths:
                warnings.append(f"'{match.name}' is named twice and read once")
            paths[plain] = None
    return FoundFiles(tuple(paths), tuple(faults), tuple(warnings))


def held_out_faults(identify: Sequence[Path], validate: Sequence[Path]) -> list[str]:
    """Find files that are in both lists, by name or by link; what they hold is compared once they are read."""
    real = {path.resolve() for path in identify}
    return [
        f"'{path.name}' is in identify as well: what is held out must not be used for fitting; take it out of one of "
        "the lists"
        for path in validate
        if path.resolve() in real
    ]
