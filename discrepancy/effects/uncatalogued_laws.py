"""Forces that no kind of the catalogue describes, for tests of what is said about an unknown effect."""

# Equations are read as text and never run: their names are quantities, which a type checker cannot know.
# mypy: disable-error-code="attr-defined,operator,assignment"

from __future__ import annotations

import math

from multibody.declare.component import Component
from multibody.declare.declarations import Output, Parameter, Power
from multibody.declare.domains import in_both_domains
from multibody.library.laws import bell

__all__ = ["OVER", "UNKNOWN_LAWS"]

OVER = ("position", "speed", "time")


class _Unknown(Component):
    force = Output("F", "what the effect exerts on the first side")
    loss = Power(kind="loss")

    def equations(self):
        self.a.force = self.force
        self.b.force = -self.force
        self.loss = -self.force * (self.a.velocity - self.b.velocity)


class _OverPosition(_Unknown):
    """F = −level·tanh((x − centre)/width)"""

    level = Parameter(None, "F", "largest force")
    centre = Parameter(0.0, "X", "where it changes sign")
    width = Parameter(1.0, "X", "half width of the change", min=1e-300)

    def equations(self):
        super().equations()
        self.force = -self.level * math.tanh((self.a.position - self.b.position - self.centre) / self.width)


class _OverSpeed(_Unknown):
    """F = level·v²/(v² + v_half²), the same way for both directions of motion"""

    level = Parameter(None, "F", "force at high speed")
    v_half = Parameter(1.0, "V", "speed at half the force", min=1e-300)

    def equations(self):
        super().equations()
        v = self.a.velocity - self.b.velocity
        self.force = self.level * v * v / (v * v + self.v_half * self.v_half)


class _OverTime(_Unknown):
    """F = level·exp(−((t − t_middle)/t_half)²)"""

    level = Parameter(None, "F", "largest force")
    t_middle = Parameter(None, "s", "when it is largest")
    t_half = Parameter(None, "s", "half width in time", min=1e-300)

    def equations(self):
        super().equations()
        self.force = self.level * bell(self.time, self.t_middle, self.t_half)


#: what the force is a function of → its sliding and its turning version
UNKNOWN_LAWS: dict[str, tuple[type[Component], type[Component]]] = {}
for _over, _law in zip(OVER, (_OverPosition, _OverSpeed, _OverTime), strict=True):
    _name = _law.__name__.lstrip("_")
    UNKNOWN_LAWS[_over] = in_both_domains(_law, (f"{_name}Force", f"{_name}Torque"))
