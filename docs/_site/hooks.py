"""What MkDocs does for this site beyond its settings.

A page dropped into one of the folders below stands in the navigation by itself: the folder's ``index.md`` first, then
the pages that it links to in their order, then the others by name; what a package offers to users gets a reference
page; equations between dollars become MathML at build time, because a reader of the pages may have no network.
"""

from __future__ import annotations

import ast
import html
import importlib
import importlib.util
import inspect
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
    "gallery": "Gallery",
    "howto": "How to",
    "physics": "Physics",
    "method": "Method",
    "benchmarks": "Benchmarks",
    "reference": "Reference",
}
PACKAGES = ("multibody", "estimation", "surrogate", "discrepancy", "vtsdt", "gearbox")
CATALOGUE = "physics/catalogue.md"  # written by catalogue_page.py
COMPONENTS = ("multibody.library", "vtsdt.parts")  # packages of components
INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
DISPLAY = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)


def public_names(root: Path) -> dict[str, list[str]]:
    """Full names of what each package offers, by the package that one imports it from.

    A package offers what its ``__init__`` names in ``__all__`` or, where it loads names when they are first asked for,
    in the ``__init__.pyi`` beside it.
    """
    pages = {}
    for top in PACKAGES:
        for source in sorted((root / top).rglob("__init__.py"), key=lambda path: path.parent.as_posix()):
            package = ".".join(source.parent.relative_to(root).parts)
            stub = source.with_suffix(".pyi")
            if names := _offered(stub if stub.is_file() else source, package):
                pages[package] = names
    return pages


def _shown(name: str) -> str:
    """Return the entry of a name: from its source or, of a component, whose docstring is made, from the class."""
    module, _, last = name.rpartition(".")
    value = getattr(importlib.import_module(module), last) if ".".join(name.split(".")[:2]) in COMPONENTS else None
    if not isinstance(value, type) or not hasattr(value, "declarations"):
        options = "show_root_heading: true, show_root_toc_entry: true, show_root_full_path: false, heading_level: 2"
        return f"::: {name}\n    options: {{{options}}}"
    lines = [f"## {last}", ""]
    for section in re.split(r"\n(?=\w+\n-{3,}\n)", inspect.getdoc(value) or ""):
        title, underline, entries = section.partition("\n---")
        if not underline:
            lines += [section, ""]
            continue
        lines += [f"**{title}**", "", "| name | what it is | meaning |", "| --- | --- | --- |"]
        for entry in re.split(r"\n(?=\S)", entries.partition("\n")[2].strip()):
            head, _, meaning = entry.partition("\n")
            word, _, kind = head.partition(" : ")
            lines.append(f"| `{word}` | {kind.rstrip(', ')} | {' '.join(meaning.split())} |")
        lines.append("")
    return "\n".join(lines)


def _offered(file: Path, package: str) -> list[str]:
    """Full names of what an ``__init__`` takes from modules and lists in ``__all__``."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    listed: set[str] = set()
    for node in tree.body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__":
            listed = {str(each.value) for each in ast.walk(node.value) if isinstance(each, ast.Constant)}
    names = []
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and node.module:
            module = f"{package}.{node.module}" if node.level else node.module
            names += [f"{module}.{each.name}" for each in node.names if (each.asname or each.name) in listed]
    return sorted(names, key=lambda name: name.rpartition(".")[2].lower())


def _root(config: MkDocsConfig) -> Path:
    return Path(config.docs_dir).parent


def _pages(folder: Path, docs: Path) -> list[Any]:
    """Navigation of a folder: its index, its pages in the order in which the index links them, then its folders."""
    index = folder / "index.md"
    linked = re.findall(r"\(([\w-]+\.md)", index.read_text(encoding="utf-8")) if index.is_file() else []
    place = {name: k for k, name in reversed(list(enumerate(linked)))}
    pages = sorted(folder.glob("*.md"), key=lambda path: (path != index, place.get(path.name, len(linked)), path.name))
    entries: list[Any] = [path.relative_to(docs).as_posix() for path in pages]
    for below in sorted(path for path in folder.iterdir() if path.is_dir()):
        inside = _pages(below, docs)
        if inside:
            entries.append({below.name.replace("-", " ").capitalize(): inside})
    return entries


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Lay out the navigation from the folders and the packages."""
    docs = Path(config.docs_dir)
    nav: list[Any] = ["index.md"]
    for folder, title in SECTIONS.items():
        entries = _pages(docs / folder, docs) if (docs / folder).is_dir() else []
        if folder == "physics":
            entries.append(CATALOGUE)
        if folder == "reference":
            entries += [{package: f"reference/{package}.md"} for package in public_names(_root(config))]
        if entries:
            nav.append({title: entries})
    config.nav = nav
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the reference pages, the catalogue of effects and the style sheet of the coloured code."""
    pages: dict[str, str] = {}  # each name is shown once, on the first page that offers it
    for package, names in public_names(_root(config)).items():
        parts = [f"# {package}", f"::: {package}\n    options:\n      members: []"]
        others = [f"`{name.rpartition('.')[2]}` ([{pages[name]}]({pages[name]}.md))" for name in names if name in pages]
        if others:
            parts.append(f"Also imported from here: {', '.join(others)}.")
        parts += [_shown(name) for name in names if name not in pages]
        pages |= {name: package for name in names if name not in pages}
        files.append(File.generated(config, f"reference/{package}.md", content="\n\n".join(parts) + "\n"))
    page = _catalogue(config)
    files.append(File.generated(config, CATALOGUE, content=page.catalogue_page()))
    for path, picture in page.pictures().items():
        files.append(File.generated(config, path, content=picture))
    style = HtmlFormatter(style="friendly").get_style_defs(".highlight")
    files.append(File.generated(config, "assets/pygments.css", content=style))
    return files


def _catalogue(config: MkDocsConfig) -> Any:
    """Return the module beside this file that writes the page of the catalogue."""
    spec = importlib.util.spec_from_file_location("catalogue_page", Path(config.docs_dir) / "_site/catalogue_page.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


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
