"""Pages that open offline: one head, one style and the same tables for every report of the project."""

from __future__ import annotations

import base64
from typing import Any

__all__ = ["picture_address", "rendered"]

HOME = "discrepancy"  # package whose templates hold what every page shares


def rendered(package: str, template: str, /, **content: Any) -> str:
    """Return a page as HTML that needs nothing from outside.

    Parameters
    ----------
    package : str
        Package in whose folder ``templates`` the template is.
    template : str
        Name of the template, which extends ``base.html``.
    **content
        What the template shows; text is escaped.

    Raises
    ------
    jinja2.UndefinedError
        If the template asks for something that is not given.
    """
    import jinja2

    places = dict.fromkeys((package, HOME))
    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(place, "templates") for place in places]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(template).render(**content)


def picture_address(png: bytes) -> str:
    """Return a picture as an address that holds it."""
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")
