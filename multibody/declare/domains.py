"""One law for translation and rotation: a component written once, declared for both domains.

A law names its flanges' quantities ``position``, ``velocity`` and ``force`` and writes units with the letters
``F`` (N or N m), ``X`` (m or rad), ``V`` (m/s or rad/s) and ``M`` (kg or kg m²).
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

from multibody.declare.component import Component
from multibody.declare.declarations import Declaration, Rotation, Translation

__all__ = ["in_both_domains"]

_LETTERS = {
    "translation": {"F": "N", "X": "m", "V": "(m/s)", "M": "kg"},
    "rotation": {"F": "(N*m)", "X": "rad", "V": "(rad/s)", "M": "(kg*m**2)"},
}
_PORTS: dict[str, type[Any]] = {"translation": Translation, "rotation": Rotation}


def in_both_domains(
    law: type[Component], module: str, names: tuple[str, str]
) -> tuple[type[Component], type[Component]]:
    """Return the translational and the rotational version of a law between two flanges ``a`` and ``b``.

    Parameters
    ----------
    law : type
        Component without ports; its equations use ``self.a`` and ``self.b``.
    module : str
        Module that will hold the two classes (``__name__``), so that they can be imported by name.
    names : (str, str)
        Names of the two classes.
    """
    made = []
    for domain, name in zip(_PORTS, names, strict=True):
        body: dict[str, Any] = {
            key: replace(item, unit=_units(item.unit, domain))  # type: ignore[attr-defined, call-arg]
            for key, item in law.declarations.items()
            if getattr(item, "unit", None) is not None
        }
        for item in body.values():
            if not isinstance(item, Declaration):
                raise TypeError(f"{law.__name__} declares something that is not a declaration")
        port = _PORTS[domain]
        body |= {"a": port("first side"), "b": port("second side"), "__module__": module}
        made.append(type(name, (law,), body))
    return made[0], made[1]


def _units(text: str, domain: str) -> str:
    """Return a unit with the letters of a law replaced by those of a domain.

    Examples
    --------
    >>> _units("F/V", "translation"), _units("F", "rotation"), _units("kg", "rotation")
    ('N/(m/s)', '(N*m)', 'kg')
    """
    return re.sub(r"\b[FXVM]\b", lambda m: _LETTERS[domain][m.group()], text)
