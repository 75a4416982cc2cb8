"""The signature and the docstring of a component class, made from its declarations when they are read."""

from __future__ import annotations

import inspect
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from multibody.declare.declarations import (
    Declaration,
    Energy,
    Input,
    Option,
    Output,
    Parameter,
    Port,
    Power,
    State,
    Table,
    Unit,
)

__all__ = ["DocstringOfDeclarations", "RequiredWhere", "SignatureOfDeclarations", "written_docstring"]

_SETTABLE = Parameter | Table | Option | Unit | State
_ENERGY_BALANCE = Energy | Power


class Declaring(Protocol):
    """A class that declares what its constructor accepts."""

    declarations: dict[str, Declaration]

    @classmethod
    def possible_starts(cls) -> dict[str, State]:
        """Return the start values that the constructor accepts under some choice of options, by name."""


@dataclass(frozen=True)
class RequiredWhere:
    """The default, in a signature, of a value that is required where a condition on the options holds."""

    condition: str

    def __repr__(self) -> str:
        return f"<required where {self.condition}>"


def accepted(cls: type[Declaring]) -> dict[str, Declaration]:
    """Return what the constructor of a class accepts, by name: required values first, start values last."""
    settable = {n: d for n, d in cls.declarations.items() if isinstance(d, _SETTABLE) and not isinstance(d, State)}
    required = {n: d for n, d in settable.items() if default_of(d) is inspect.Parameter.empty}
    return {**required, **settable, **cls.possible_starts()}


def default_of(item: Declaration) -> Any:
    """Return the default of a declaration for a signature."""
    value = item.start if isinstance(item, State) else getattr(item, "default", None)
    if value is not None:
        return value
    return RequiredWhere(item.when) if item.when else inspect.Parameter.empty


class SignatureOfDeclarations:
    """The attribute ``__signature__`` of a component class: every value that it accepts, keyword-only."""

    def __get__(self, instance: Any, owner: type[Declaring]) -> inspect.Signature:
        own = list(inspect.signature(owner.__init__).parameters.values())[1:]
        positional = [p for p in own if p.kind is not p.VAR_KEYWORD]
        if len(positional) == len(own):  # a constructor without ``**given`` takes nothing else
            return inspect.Signature(own)
        named = {p.name for p in positional}
        declared = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default_of(item))
            for name, item in accepted(owner).items()
            if name not in named
        ]
        return inspect.Signature([*positional, *declared])


class DocstringOfDeclarations:
    """The attribute ``__doc__`` of a component class: the written text, then the declarations.

    Parameters
    ----------
    text : str
        The docstring as it is written in the class.
    """

    def __init__(self, text: str) -> None:
        self.text = text

    def __get__(self, instance: Any, owner: type[Declaring]) -> str:
        text = inspect.cleandoc(self.text)
        if "\nParameters\n" in text:
            return text
        head, example, rest = text.partition("\nExamples\n--------")
        sections = [
            *_section("Parameters", accepted(owner)),
            *_section("Attributes", {n: d for n, d in owner.declarations.items() if _is_connectable(d)}),
        ]
        return "\n".join([head.rstrip(), *sections, example + rest]).rstrip()


def written_docstring(cls: type[Declaring]) -> str:
    """Return the docstring of a component class as it is written, without the sections made from declarations."""
    docstring = vars(cls)["__doc__"]
    return docstring.text if isinstance(docstring, DocstringOfDeclarations) else docstring


def _is_connectable(item: Declaration) -> bool:
    return isinstance(item, Port | Input | Output) and not isinstance(item, _ENERGY_BALANCE)


def _section(title: str, items: Mapping[str, Declaration]) -> Iterator[str]:
    if items:
        yield from ("", title, "-" * len(title))
    for name, item in items.items():
        yield f"{name} : {', '.join(_kind(item))}"
        yield textwrap.indent(textwrap.fill(_meaning(item), 110), "    ")


def _kind(item: Declaration) -> Iterator[str]:
    """Kind, unit and default of a declaration, as numpydoc puts them behind the name."""
    unit = getattr(item, "unit", "")
    match item:
        case Parameter() | State():
            yield "float"
        case Table():
            yield "(x, y)"
            unit = f"{item.x_unit or '1'} and {item.unit or '1'}"
        case Option():
            yield type(item.default).__name__
        case Unit():
            yield "str"
        case Port():
            yield f"{item.domain} port"
        case _:
            yield type(item).__name__.lower()
    if unit:
        yield unit
    if isinstance(item, _SETTABLE):
        value = default_of(item)
        if isinstance(value, RequiredWhere):
            yield f"required where {value.condition}"
            return
        if isinstance(item, Table) and item.default is not None:
            yield "optional"
        elif value is not inspect.Parameter.empty:
            yield f"default {value:g}" if isinstance(value, float) else f"default {value!r}"
    if item.when:
        yield f"where {item.when}"


def _meaning(item: Declaration) -> str:
    """The declared sentence, with the bounds of a parameter and the choices of an option."""
    text = str(getattr(item, "meaning", "")) or item.name
    if isinstance(item, State) and "at the start" not in text:
        text += " at the start"
    if isinstance(item, Parameter | State):
        bounds = [f"at least {item.min:g}"] if item.min is not None else []
        bounds += [f"at most {item.max:g}"] if item.max is not None else []
        text = ", ".join([text, *bounds])
    elif isinstance(item, Option) and item.choices is not None:
        text += f"; one of {', '.join(map(repr, item.choices))}"
    return text if text.endswith(".") else f"{text}."
