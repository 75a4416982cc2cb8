"""Check the built site: it needs no network, links lead somewhere, equations are set, the search finds, pages fit.

Usage: python .ci/check_site.py SITE [PICTURES]

Chromium opens every page, as wide as a desk and as a telephone, and writes what it shows into the folder PICTURES where
one is given; the search is tried from the disk and over HTTP.  Without Chromium or playwright that is skipped and said.
"""

from __future__ import annotations

import http.server
import re
import shutil
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from urllib.parse import unquote

# Links that a reader may follow are fine; what a browser loads by itself is not.
LOADED = re.compile(
    r"""<(?:script|img|iframe|source|video|audio)\b[^>]*\bsrc=["'](?:https?:)?//[^"']*"""
    r"""|<link\b[^>]*\bhref=["'](?:https?:)?//[^"']*"""
)
LOADED_CSS = re.compile(r"""url\(\s*["']?(?:https?:)?//[^)]*|@import\s+["'](?:https?:)?//[^;]*""")
UNSET = re.compile(r'class="arithmatex">.{0,60}', re.DOTALL)
LINK = re.compile(r"""<[a-z][^>]*\s(?:href|src)=["']?([^"'\s>]+)""")
ELSEWHERE = re.compile(r"[a-z][a-z0-9+.-]*:|//", re.IGNORECASE)
ID = re.compile(r"""\s(?:id|name)=["']?([^"'\s>]+)""")
CODE = re.compile(r"<(pre|script)\b.*?</\1>", re.DOTALL)

#: What is typed, and a page that has to be among the answers.
WORDS, WANTED = "stribeck", "physics/catalogue.html"
#: Pixels: a desk and a telephone.
WIDTHS = (1400, 400)
PATIENCE = 60_000  # ms, for the index to be loaded on a busy computer


def faults(site: Path) -> list[str]:
    """Everything in the site that would load from elsewhere, was left as raw TeX, or leads nowhere."""
    found = []
    for pattern, suffix in ((LOADED, "html"), (UNSET, "html"), (LOADED_CSS, "html"), (LOADED_CSS, "css")):
        for path in sorted(site.rglob(f"*.{suffix}")):
            text = path.read_text(encoding="utf-8")
            found += [f"{path.relative_to(site)}: {m.group(0)[:120]}" for m in pattern.finditer(text)]
    return found + dead_links(site)


def dead_links(site: Path) -> list[str]:
    """Links to files and headings of the site that are not there."""
    pages = {path.resolve(): CODE.sub("", path.read_text(encoding="utf-8")) for path in sorted(site.rglob("*.html"))}
    names = {path: set(ID.findall(text)) for path, text in pages.items()}
    dead = []
    for path, text in pages.items():
        if path.name == "404.html":
            continue  # is shown at any address, so that its links begin at the root of a server
        for target in sorted(set(LINK.findall(text))):
            if ELSEWHERE.match(target):
                continue
            name, _, anchor = unquote(target).partition("#")
            file = (path.parent / name.partition("?")[0]).resolve() if name else path
            if not file.is_file() or (anchor and file in names and anchor not in names[file]):
                dead.append(f"{path.relative_to(site.resolve())}: {target} leads nowhere")
    return dead


def chromium() -> str | None:
    """Return the path of Chromium or Chrome, or None where there is none."""
    return next(
        (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
    )


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *words: object) -> None:
        """Say nothing."""


@contextmanager
def served(site: Path) -> Iterator[str]:
    """Serve a folder on this computer and yield the address."""
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(site))) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
            thread.join()


def search_faults(site: Path) -> list[str]:
    """Where a search does not find what it should: from the disk, and over HTTP."""
    from playwright.sync_api import Error, sync_playwright

    found = []
    with served(site) as address, sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium(), args=["--no-sandbox"])
        for base in (site.resolve().as_uri(), address):
            page = browser.new_page()
            try:
                page.goto(f"{base}/howto/index.html")
                page.get_by_role("button", name="Search").first.click(timeout=PATIENCE)
                page.keyboard.type(WORDS)
                page.locator(f'a[href*="{WANTED}"]', has_text=re.compile(WORDS, re.IGNORECASE)).first.wait_for(
                    timeout=PATIENCE
                )
            except Error as error:
                found.append(f"searched for '{WORDS}' at {base}: no hit in {WANTED}: {str(error).splitlines()[0]}")
        browser.close()
    return found


def walk_faults(site: Path, pictures: Path | None = None) -> list[str]:
    """Where a page is wider than the screen, shows an image that is not there, or has a fault in its scripts."""
    from playwright.sync_api import sync_playwright

    found: list[str] = []
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium(), args=["--no-sandbox"])
        for width in WIDTHS:
            page = browser.new_page(viewport={"width": width, "height": 900})
            told: list[str] = []
            page.on("pageerror", lambda error, told=told: told.append(f"fault in a script: {error}"))
            for path in sorted(site.resolve().rglob("*.html")):
                name = path.relative_to(site.resolve())
                page.goto(path.as_uri())
                wide = page.evaluate("document.documentElement.scrollWidth - document.documentElement.clientWidth")
                if wide > 0:
                    told.append(f"{wide} px wider than the screen")
                told += page.evaluate(
                    "[...document.images].filter(i => i.complete && !i.naturalWidth).map(i => `no image ${i.src}`)"
                )
                found += [f"{name} at {width} px: {text}" for text in told]
                told.clear()
                if pictures is not None:
                    page.screenshot(
                        path=pictures / f"{'-'.join(name.with_suffix('').parts)}-{width}.png", full_page=True
                    )
        browser.close()
    return found


def main() -> int:
    """Print what was found; 1 if anything was, or if there is no site."""
    site = Path(sys.argv[1])
    pictures = Path(sys.argv[2]) if len(sys.argv) > 2 else None
    if pictures is not None:
        pictures.mkdir(parents=True, exist_ok=True)
    pages = list(site.rglob("*.html"))
    if not pages:
        print(f"{site}: no pages; build the site first (python -m docs.generate && python -m zensical build --strict)")
        return 1
    found = faults(site)
    try:
        import playwright  # noqa: F401
    except ModuleNotFoundError:
        print("skipped: the search and how pages look, which need playwright (pip install playwright)")
    else:
        if chromium() is None:
            print("skipped: the search and how pages look, which need Chromium (Debian: apt-get install chromium)")
        else:
            found += search_faults(site) + walk_faults(site, pictures)
    for line in found:
        print(line)
    print(f"{len(pages)} pages, {len(found)} faults")
    return 1 if found else 0


if __name__ == "__main__":
    raise SystemExit(main())
