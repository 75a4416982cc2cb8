"""One law for translation and rotation: a component written once, declared for both domains.

A law names its flanges' quantities ``position``, ``velocity`` and ``force`` and writes units with the letters
``F`` (N or N m), ``X`` (m or rad), ``V`` (m/s or rad/s) and ``M`` (kg or kg m²).
"""

from __future__ import annotations

import re
import sys
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


def in_both_domains(law: type[Component], names: tuple[str, str]) -> tuple[type[Component], type[Component]]:
    """Return the translational and the rotational version of a law between two flanges ``a`` and ``b``.

    The two classes are put at the top of the law's module, so that they can be imported by name and a model that has
    them can be saved.

    Parameters
    ----------
    law : type
        Component without ports; its equations use ``self.a`` and ``self.b``.
    names : (str, str)
        Names of the two classes.

    Raises
    ------
    ValueError
        If the law is written inside a function or class, or something else of its module has one of the names.
    """
    module = law.__module__
    if "." in law.__qualname__:
        raise ValueError(
            f"the law {law.__qualname__} of {module} is not at the top of its file: move it there, so that a model "
            "that has it can be saved and loaded"
        )
    home = vars(sys.modules[module])
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
        if name in home and not _is_version_of(law, home[name]):
            raise ValueError(f"{module} has another '{name}': rename it, or the law '{law.__name__}'")
        home[name] = type(name, (law,), body)
        made.append(home[name])
    return made[0], made[1]


def _is_version_of(law: type[Component], there: Any) -> bool:
    """Tell whether a class was made from a law of this name before, as when a file is loaded again."""
    return isinstance(there, type) and [base.__qualname__ for base in there.__bases__] == [law.__qualname__]


def _units(text: str, domain: str) -> str:
    """Return a unit with the letters of a law replaced by those of a domain.

    Examples
    --------
    >>> _units("F/V", "translation"), _units("F", "rotation"), _units("kg", "rotation")
    ('N/(m/s)', '(N*m)', 'kg')
    """
    return re.sub(r"\b[FXVM]\b", lambda m: _LETTERS[domain][m.group()], text)
