"""Fail unless a diagnosis names what was hidden on a virtual machine, at its place, and nothing beside it.

``python .ci/check_main.py out/axis out/diagnosis``
"""

from __future__ import annotations

import json
import sys
from pathlib import Path


def main() -> int:
    """Compare the effects of ``diagnosis.json`` with those of ``truth.json``; return 1 where they differ."""
    machine, folder = map(Path, sys.argv[1:])
    hidden, named = effects(machine / "truth.json"), effects(folder / "diagnosis.json")
    if named == hidden:
        return 0
    print(f"{folder}: hidden is {', '.join(hidden) or 'nothing'}, and named {', '.join(named) or 'nothing'}")
    return 1


def effects(file: Path) -> list[str]:
    """Return the effects that a file lists, as kind@where, sorted."""
    listed = json.loads(file.read_text(encoding="utf-8"))["effects"]
    return sorted(f"{effect['kind']}@{effect['where']}" for effect in listed)


if __name__ == "__main__":
    sys.exit(main())
