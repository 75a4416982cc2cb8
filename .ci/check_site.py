"""Check the built site: it needs no network, its links lead somewhere, its equations are set, and its search finds.

Usage: python .ci/check_site.py SITE

The search is tried in Chromium, from the disk and over HTTP; without Chromium or playwright that is skipped and said.
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


def main() -> int:
    """Print what was found; 1 if anything was, or if there is no site."""
    site = Path(sys.argv[1])
    pages = list(site.rglob("*.html"))
    if not pages:
        print(f"{site}: no pages; build the site first (python -m docs.generate && python -m zensical build --strict)")
        return 1
    found = faults(site)
    try:
        import playwright  # noqa: F401
    except ModuleNotFoundError:
        print("skipped: the search, which needs playwright (pip install playwright)")
    else:
        if chromium() is None:
            print("skipped: the search, which needs Chromium (Debian: apt-get install chromium)")
        else:
            found += search_faults(site)
    for line in found:
        print(line)
    print(f"{len(pages)} pages, {len(found)} faults")
    return 1 if found else 0


if __name__ == "__main__":
    raise SystemExit(main())
