"""The same pages built by several generators, each in an environment of its own, and searched in Chromium.

After ``python -m docs.generate``, ``python benchmarks/site_generators.py --page docs/development/site-generator.md``
installs each generator, builds the site twice, tries the search from the disk and over HTTP, and writes the table into
the page.  It needs a network for pip, the packages of the extra ``browser``, and Chromium; nothing of it is kept.
"""

from __future__ import annotations

import argparse
import datetime
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench_walk import opened

if TYPE_CHECKING:
    from playwright.sync_api import Page

ROOT = Path(__file__).resolve().parents[1]
PATIENCE = 60_000  # ms, for an index to be loaded on a busy computer
WORDS = "stribeck"
API = ("mkdocstrings[python]", "latex2mathml")

SPHINX = """project = "vtsdt"
extensions = ["myst_parser"]
html_theme = "furo"
myst_enable_extensions = ["dollarmath", "attrs_inline"]
myst_heading_anchors = 4
exclude_patterns = ["reference/api"]
"""


def themed(theme: str, *without: str) -> Callable[[str], str]:
    """Return what puts another theme, with settings of its own, into those of the site, and leaves some lines out."""

    def settings(text: str) -> str:
        text = re.sub(r"^theme:\n(?:  .*\n)+", f"theme:\n  name: {theme}\n", text, flags=re.MULTILINE)
        return "".join(line for line in text.splitlines(keepends=True) if line.strip() not in without)

    return settings


def typed(box: str, results: str) -> Callable[[Page, str], None]:
    """Return a search by typing into a box that answers on the same page."""

    def search(page: Page, base: str) -> None:
        page.goto(f"{base}/howto/index.html")
        page.locator(box).first.click(timeout=PATIENCE)
        page.keyboard.type(WORDS)
        page.locator(results, has_text=re.compile(WORDS, re.IGNORECASE)).first.wait_for(timeout=PATIENCE)

    return search


def asked(results: str) -> Callable[[Page, str], None]:
    """Return a search by a page of results."""

    def search(page: Page, base: str) -> None:
        page.goto(f"{base}/search.html?q={WORDS}")
        page.locator(results).first.wait_for(timeout=PATIENCE)

    return search


@dataclass(frozen=True, kw_only=True)
class Generator:
    """What is installed and run, and how its search is used."""

    packages: tuple[str, ...]
    command: tuple[str, ...]
    settings: Callable[[str], str]
    search: Callable[[Page, str], None]
    sections: str
    file: str = "mkdocs.yml"


CATALOGUE = 'a[href*="physics/catalogue.html"]'
GENERATORS = {
    "Zensical": Generator(
        packages=("zensical", *API),
        command=("zensical", "build", "--strict"),
        settings=lambda text: text,
        search=typed(".md-search__button", CATALOGUE),
        sections="sections with an excerpt, while typing",
    ),
    "Material for MkDocs": Generator(
        packages=("mkdocs-material", *API),
        command=("mkdocs", "build", "--strict", "-d", "site"),
        settings=themed("material\n  font: false"),
        search=typed(".md-search__input", f".md-search-result {CATALOGUE}"),
        sections="sections with an excerpt, while typing",
    ),
    "MkDocs": Generator(
        packages=("mkdocs", *API),
        command=("mkdocs", "build", "--strict", "-d", "site"),
        settings=themed("readthedocs\n  highlightjs: false", "- offline"),
        search=asked(f"#mkdocs-search-results {CATALOGUE}"),
        sections="sections, on a page of results",
    ),
    "ProperDocs": Generator(
        packages=("properdocs", "properdocs-theme-readthedocs", *API),
        command=("properdocs", "build", "--strict", "-f", "mkdocs.yml", "-d", "site"),
        settings=themed("readthedocs\n  highlightjs: false", "- offline"),
        search=asked(f"#mkdocs-search-results {CATALOGUE}"),
        sections="sections, on a page of results",
    ),
    "Sphinx (MyST, Furo)": Generator(
        packages=("sphinx", "myst-parser", "furo"),
        command=("sphinx", "-b", "html", "-q", "docs", "site"),
        settings=lambda text: SPHINX,
        search=asked(f"#search-results {CATALOGUE}"),
        sections="pages, on a page of results",
        file="docs/conf.py",
    ),
}


def measured(generator: Generator, tree: Path, work: Path) -> dict[str, str]:
    """Install a generator, build the site of a tree with it, search it, and return the row of the table."""
    shutil.rmtree(work, ignore_errors=True)
    shutil.copytree(tree, work / "tree")
    subprocess.run([sys.executable, "-m", "venv", work / "venv"], check=True)
    python = work / "venv/bin/python"
    bare = size(work / "venv")
    subprocess.run([python, "-m", "pip", "install", "-q", *generator.packages], check=True, stderr=subprocess.DEVNULL)
    version = subprocess.run(
        [python, "-c", f"from importlib.metadata import version; print(version('{generator.packages[0]}'))"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.strip()
    settings = work / "tree" / generator.file
    settings.write_text(generator.settings((work / "tree/mkdocs.yml").read_text(encoding="utf-8")), encoding="utf-8")
    times, warnings = [], 0
    for _ in range(2):
        begun = time.perf_counter()
        run = subprocess.run(
            [python, "-m", *generator.command],
            cwd=work / "tree",
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONPATH": "."},
        )
        times.append(time.perf_counter() - begun)
        if run.returncode:
            raise SystemExit(f"{generator.command}: {run.stdout[-2000:]}{run.stderr[-2000:]}")
        warnings = max(warnings, len(re.findall(r"^.*\bWARNING\b", run.stderr, re.MULTILINE)))
    site = work / "tree/site"
    pages = [path.read_text(encoding="utf-8") for path in site.rglob("*.html")]
    from_disk, over_http = searched(site, generator.search)
    return {
        "version": version,
        "installed [MB]": f"{(size(work / 'venv') - bare) / 1e6:.0f}",
        "first build [s]": f"{times[0]:.1f}",
        "second build, nothing changed [s]": f"{times[1]:.1f}",
        "warnings": str(warnings),
        "site [MB]": f"{size(site) / 1e6:.1f}",
        "pages": str(len(pages)),
        "equations as MathML": str(sum(page.count("<math") for page in pages)),
        "pages that load from elsewhere": str(sum(loads_from_elsewhere(page) for page in pages)),
        "search from the disk": from_disk,
        "search over HTTP": over_http,
        "the search finds": generator.sections,
    }


def size(folder: Path) -> int:
    """Return the bytes of all files in a folder."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def check_site() -> Any:
    """Return the module that checks the built site."""
    spec = importlib.util.spec_from_file_location("check_site", ROOT / ".ci/check_site.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def loads_from_elsewhere(page: str) -> bool:
    """Say whether a browser would load something from another place by itself."""
    return check_site().LOADED.search(page) is not None


def searched(site: Path, search: Callable[[Page, str], None]) -> tuple[str, str]:
    """Say for a site whether its search finds, from the disk and over HTTP, without a network."""
    from playwright.sync_api import Error

    found = []
    with check_site().served(site) as address, opened() as browser:
        for base in (site.as_uri(), address):
            page = browser.new_page()
            page.route(
                lambda url: not url.startswith(("file:", address, "data:", "blob:")), lambda route: route.abort()
            )
            try:
                search(page, base)
                found.append("yes")
            except Error:
                found.append("no")
    return found[0], found[1]


def table(rows: dict[str, dict[str, str]]) -> str:
    """Return the measured rows, a column for each generator."""
    lines = [f"| | {' | '.join(rows)} |", f"|---|{'---|' * len(rows)}"]
    lines += [f"| {key} | {' | '.join(row[key] for row in rows.values())} |" for key in next(iter(rows.values()))]
    return "\n".join(lines)


def main() -> None:
    """Measure the generators that are named, or all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("generators", nargs="*", metavar="NAME", help=f"of {', '.join(GENERATORS)}")
    parser.add_argument("--page", type=Path, help="write the table into this page")
    args = parser.parse_args()
    names = args.generators or list(GENERATORS)
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        tree = work / "tree"
        left_out = shutil.ignore_patterns(".git", ".venv*", "site", ".cache", "out", "__pycache__", ".*_cache")
        shutil.copytree(ROOT, tree, ignore=left_out)
        rows = {}
        for name in names:
            rows[name] = measured(GENERATORS[name], tree, work / "one")
            print(name, rows[name], flush=True)
    text = table(rows)
    print(text)
    if args.page:
        commit = subprocess.run(
            ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, cwd=ROOT
        ).stdout
        busy, cores = os.getloadavg()[0], os.cpu_count()
        stamp = f"Measured on {datetime.date.today()} at {commit.strip()}, Python {sys.version.split()[0]}, "
        stamp += f"with {busy:.0f} programs at work on {cores} cores."
        page = args.page.read_text(encoding="utf-8")
        new = f"<!-- measures -->\n{stamp}\n\n{text}\n<!-- /measures -->"
        page = re.sub(r"<!-- measures -->.*<!-- /measures -->", lambda _: new, page, flags=re.DOTALL)
        args.page.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
