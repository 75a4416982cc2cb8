"""What MkDocs does for this site beyond its settings.

A page dropped into one of the folders below stands in the navigation by itself, in the order of the file
names, with the folder's ``index.md`` first; every public module gets a reference page; equations between
dollars become MathML at build time, because a reader of the pages may have no network.
"""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from pygments.formatters import HtmlFormatter

SECTIONS = {
    "tutorial": "Tutorial",
    "howto": "How to",
    "physics": "Physics",
    "method": "Method",
    "benchmarks": "Benchmarks",
    "reference": "Reference",
}
PACKAGES = ("multibody", "estimation", "surrogate", "discrepancy", "vtsdt", "gearbox")
INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
DISPLAY = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)


def modules(root: Path) -> list[str]:
    """Dotted names of the public modules of the project, packages before what is in them."""
    names = []
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py"), key=lambda p: p.relative_to(root).as_posix()):
            parts = path.relative_to(root).with_suffix("").parts
            if parts[-1] == "__init__":
                parts = parts[:-1]
            if not any(part.startswith("_") for part in parts):
                names.append(".".join(parts))
    return sorted(names, key=lambda name: (PACKAGES.index(name.split(".")[0]), name))


def _root(config: MkDocsConfig) -> Path:
    return Path(config.docs_dir).parent


def _pages(folder: Path, docs: Path) -> list[Any]:
    """Navigation of a folder: its index, its pages, then its folders."""
    pages = sorted(folder.glob("*.md"), key=lambda path: (path.name != "index.md", path.name))
    entries: list[Any] = [path.relative_to(docs).as_posix() for path in pages]
    for below in sorted(path for path in folder.iterdir() if path.is_dir()):
        inside = _pages(below, docs)
        if inside:
            entries.append({below.name.replace("-", " ").capitalize(): inside})
    return entries


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Lay out the navigation from the folders and the modules."""
    docs = Path(config.docs_dir)
    nav: list[Any] = ["index.md"]
    for folder, title in SECTIONS.items():
        entries = _pages(docs / folder, docs) if (docs / folder).is_dir() else []
        if folder == "reference":
            names = modules(_root(config))
            for package in PACKAGES:
                pages = [{n: f"reference/{n}.md"} for n in names if n.split(".")[0] == package]
                entries.append({package: pages})
        if entries:
            nav.append({title: entries})
    config.nav = nav
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the reference pages and the style sheet of the coloured code."""
    for name in modules(_root(config)):
        text = f"# {name}\n\n::: {name}\n"
        files.append(File.generated(config, f"reference/{name}.md", content=text))
    style = HtmlFormatter(style="friendly").get_style_defs(".highlight")
    files.append(File.generated(config, "assets/pygments.css", content=style))
    return files


def _mathml(page: Page, display: str) -> Any:
    def replace(match: re.Match[str]) -> str:
        source = html.unescape(match.group(1)).strip()
        try:
            result = convert(source, display=display)
        except Exception as error:
            where = page.file.src_uri
            raise PluginError(f"{where}: cannot set the equation '{source}': {error!r}") from error
        return f'<div class="equation">{result}</div>' if display == "block" else result

    return replace


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Replace the equations that arithmatex found by MathML."""
    return INLINE.sub(_mathml(page, "inline"), DISPLAY.sub(_mathml(page, "block"), html))
