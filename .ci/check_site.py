"""Check that the built site needs no network and that every equation was set.

Usage: python .ci/check_site.py SITE
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

# Links that a reader may follow are fine; what a browser loads by itself is not.
LOADED = re.compile(
    r"""<(?:script|img|iframe|source|video|audio)\b[^>]*\bsrc=["'](?:https?:)?//[^"']*"""
    r"""|<link\b[^>]*\bhref=["'](?:https?:)?//[^"']*"""
)
LOADED_CSS = re.compile(r"""url\(\s*["']?(?:https?:)?//[^)]*|@import\s+["'](?:https?:)?//[^;]*""")
UNSET = re.compile(r'class="arithmatex">.{0,60}', re.DOTALL)


def faults(site: Path) -> list[str]:
    """Everything in the site that would load from elsewhere or was left as raw TeX."""
    found = []
    for pattern, suffix in ((LOADED, "html"), (UNSET, "html"), (LOADED_CSS, "html"), (LOADED_CSS, "css")):
        for path in sorted(site.rglob(f"*.{suffix}")):
            text = path.read_text(encoding="utf-8")
            found += [f"{path.relative_to(site)}: {m.group(0)[:120]}" for m in pattern.finditer(text)]
    return found


def main() -> int:
    """Print what was found; 1 if anything was, or if there is no site."""
    site = Path(sys.argv[1])
    pages = list(site.rglob("*.html"))
    if not pages:
        print(f"{site}: no pages; build the site first (mkdocs build --strict)")
        return 1
    found = faults(site)
    for line in found:
        print(line)
    print(f"{len(pages)} pages, {len(found)} faults")
    return 1 if found else 0


if __name__ == "__main__":
    raise SystemExit(main())
