"""Fail unless the diagnosis of the README names the effect that was hidden, and nothing beside it.

``python .ci/check_main.py out/diagnosis stribeck_friction``
"""

from __future__ import annotations

import json
import sys
from pathlib import Path


def main() -> int:
    """Compare the effects of ``diagnosis.json`` with the kind that was hidden; return 1 where they differ."""
    folder, hidden = Path(sys.argv[1]), sys.argv[2]
    diagnosis = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
    named = [effect["kind"] for effect in diagnosis["effects"]]
    print(diagnosis["sentence"])
    if named == [hidden]:
        return 0
    print(f"{folder}: one effect is hidden, {hidden}, but the diagnosis names {', '.join(named) or 'none'}")
    return 1


if __name__ == "__main__":
    sys.exit(main())
