"""Write the pages, pictures and settings of the site that come from the code: ``python -m docs.generate``.

Run it before the site is built and again after changing a docstring, a kind of effect, or the set of pages. What it
writes lies where `GENERATED` says, is ignored by git, and is plain Markdown, SVG and YAML for whatever generator
builds the site.
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path

from docs._site.catalogue_page import PICTURES, catalogue_page, pictures
from docs._site.navigation import navigation
from docs._site.reference_pages import reference_pages

DOCS = Path(__file__).resolve().parent
CATALOGUE = "physics/catalogue.md"
REFERENCE = "reference/api"
DOWNLOADS = "downloads"
NAVIGATION = "_site/navigation.yml"  # included by mkdocs.yml
GENERATED = (CATALOGUE, PICTURES, REFERENCE, DOWNLOADS, NAVIGATION)


def generate(docs: Path) -> list[Path]:
    """Write everything anew and return the files."""
    for name in (PICTURES, REFERENCE, DOWNLOADS):
        shutil.rmtree(docs / name, ignore_errors=True)
    texts = {CATALOGUE: catalogue_page()} | pictures()
    texts |= {f"{REFERENCE}/{name}": page for name, page in reference_pages(docs.parent).items()}
    notebooks = sorted((docs.parent / "examples").glob("*.ipynb"))
    texts |= {f"{DOWNLOADS}/{path.name}": path.read_text(encoding="utf-8") for path in notebooks}
    for name, text in texts.items():
        _write(docs / name, text)
    # JSON is YAML, and the navigation lists what has been written above.
    _write(docs / NAVIGATION, json.dumps({"nav": navigation(docs)}, indent=1) + "\n")
    return [docs / name for name in (*texts, NAVIGATION)]


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.is_file() or path.read_text(encoding="utf-8") != text:  # an unchanged file does not rebuild its page
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    print(f"{len(generate(DOCS))} files written in {DOCS}")
