"""Markdown extension that sets equations between dollars as MathML.

A reader of the pages may have no network, so that a script that sets them in the browser is not at hand. Which dollars
mark an equation is decided by `pymdownx.arithmatex`, how it looks by `latex2mathml`; any generator that renders with
Python-Markdown can name this module among its extensions.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as etree
from typing import Any

from latex2mathml.converter import convert_to_element
from markdown import Markdown
from markdown.extensions import Extension
from markdown.treeprocessors import Treeprocessor
from pymdownx.arithmatex import ArithmatexExtension

MARKED = re.compile(r"\\(?:\((?P<inline>.*)\\\)|\[(?P<block>.*)\\\])\s*", re.DOTALL)
AFTER_INLINE = 15  # Python-Markdown finds inline marks at 20 and indents its tags at 10


class MathmlProcessor(Treeprocessor):
    """Replace what arithmatex marked."""

    def run(self, root: etree.Element) -> None:
        """Put MathML into every marked element of a page; `ValueError` names an equation that cannot be set."""
        for element in root.iter():
            if element.get("class") == "arithmatex" and (marked := MARKED.fullmatch(element.text or "")):
                block = marked["block"] is not None
                source = (marked["block"] if block else marked["inline"]).strip()
                try:
                    equation = convert_to_element(source, display="block" if block else "inline")
                except Exception as error:
                    raise ValueError(f"cannot set the equation '{source}': {error!r}") from error
                element.set("class", "equation")
                element.text = None
                element.append(equation)


class MathmlExtension(Extension):
    """Equations between dollars as MathML."""

    def extendMarkdown(self, md: Markdown) -> None:
        """Register arithmatex, and the processor that follows it."""
        ArithmatexExtension(generic=True).extendMarkdown(md)
        md.treeprocessors.register(MathmlProcessor(md), "mathml", AFTER_INLINE)


def makeExtension(**settings: Any) -> MathmlExtension:
    """Return the extension, as Python-Markdown asks for it."""
    return MathmlExtension(**settings)
