"""Rigid transmissions that may slip in truth: a belt, a rope on a drum, a friction wheel.

A rigid transmission takes a degree of freedom from the machine, so slip is no force that could be added: it gives the
degree of freedom back.  The component is replaced by the one that creeps.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from multibody.declare.declarations import Translation
from multibody.library.transmissions import Gear, Rack, SlippingGear, SlippingRack

if TYPE_CHECKING:
    from multibody.declare.component import Component
    from multibody.machine.model import Model

__all__ = ["can_slip", "domain_of", "slipping_class", "transmitted_by", "with_slip"]

#: The rigid component, and the one that stands in its place where it slips.
SLIPPING: dict[type[Component], type[Component]] = {Gear: SlippingGear, Rack: SlippingRack}


def can_slip(component: Component) -> bool:
    """Tell whether a component is a rigid transmission that can be replaced by one that creeps.

    A screw does not slip, and one with losses is a gear whose teeth mesh.

    Examples
    --------
    >>> can_slip(Rack(radius=0.1)), can_slip(Gear(ratio=5.0, efficiency=0.9)), can_slip(SlippingRack(radius=1, creep=1))
    (True, False, False)
    """
    return type(component) in SLIPPING and not component.options.get("lossy", False)


def domain_of(component: Component) -> str:
    """Return the domain of a transmission's driven side: "translation" or "rotation"."""
    return _domain(type(component))


def slipping_class(domain: str) -> type[Component]:
    """Return the component that creeps, by the domain of its driven side.

    Raises
    ------
    ValueError
        If it is neither "translation" nor "rotation".

    Examples
    --------
    >>> slipping_class("translation").__name__
    'SlippingRack'
    """
    for cls in SLIPPING.values():
        if _domain(cls) == domain:
            return cls
    raise ValueError(
        f"slip of a transmission needs domain='translation' or 'rotation', that of its driven side, not {domain!r}"
    )


def transmitted_by(component: Component) -> str:
    """Return the name of the output that says what a transmission exerts on its driven side."""
    return "force" if domain_of(component) == "translation" else "torque"


def with_slip(model: Model, where: str, values: dict[str, float]) -> Model:
    """Return a copy of a model in which a rigid transmission creeps.

    Parameters
    ----------
    model : Model
    where : str
        Name of the transmission.
    values : dict of str to float
        ``creep`` and ``v_s``.
    """
    other = model.copy()
    rigid = other.components[where]
    ratio = {name: rigid.values[name] for name in ("ratio", "radius") if name in rigid.values}
    other.replace(where, SLIPPING[type(rigid)](**ratio, **values))
    return other


def _domain(cls: type[Component]) -> str:
    return "translation" if isinstance(cls.declarations["b"], Translation) else "rotation"  # type: ignore[attr-defined]
