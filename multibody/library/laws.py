"""Force laws as plain functions of relative position and speed, shared by translation and rotation.

Each law returns the resisting force (or torque); the components apply it. Equations call these
functions by name, so they are written in the same subset of Python as equations.
"""

from __future__ import annotations

import math

__all__ = [
    "asymmetric",
    "clearance_contact",
    "contact",
    "coulomb",
    "one_sided",
    "quadratic",
    "saturated",
    "stribeck",
    "tension_only",
    "transmission_loss",
]


def coulomb(v, level, v_s):
    """Return dry friction ``level · tanh(v / v_s)``; at ``|v| > 3 v_s`` it is within 0.5 % of ``level``."""
    return level * math.tanh(v / v_s)


def asymmetric(v, forward, backward, v_s):
    """Return a level that is ``forward`` for v ≫ v_s and ``-backward`` for v ≪ -v_s, without a jump between.

    Its product with v is never negative, because the level between the two is their mean.
    """
    s = math.tanh(v / v_s)
    return s * (0.5 * (forward + backward) + 0.5 * (forward - backward) * s)


def one_sided(v, forward, backward, v_s):
    """Return the factor that goes from ``backward`` to ``forward`` as v passes zero."""
    return 0.5 * (forward + backward) + 0.5 * (forward - backward) * math.tanh(v / v_s)


def stribeck(v, level, static, v_stribeck, exponent, v_s):
    """Return dry friction that falls from ``static`` to ``level`` as speed rises.

    Armstrong-Hélouvry, Dupont, Canudas de Wit: "A survey of models, analysis tools and compensation methods
    for the control of machines with friction", Automatica 30 (1994), eq. (5), with tanh instead of sign.
    """
    fall = math.exp(-((abs(v) / v_stribeck) ** exponent))
    return (level + (static - level) * fall) * math.tanh(v / v_s)


def quadratic(v, factor):
    """Return drag ``factor · v · |v|``."""
    return factor * v * abs(v)


def contact(depth, rate, stiffness, damping):
    """Return the force of a contact that neither pulls when it parts nor jumps when it closes.

    The damping force is limited to the spring force, as in the Modelica Standard Library's ElastoBacklash2
    (documentation there); the result lies between 0 and twice the spring force.
    """
    if depth > 0.0:
        elastic = stiffness * depth
        force = elastic + max(-elastic, min(elastic, damping * rate))
    else:
        force = 0.0
    return force


def clearance_contact(x, v, gap, stiffness, damping):
    """Return the force across a play of total width ``gap`` centred at x = 0, positive for x > gap/2."""
    return contact(x - 0.5 * gap, v, stiffness, damping) - contact(-x - 0.5 * gap, -v, stiffness, damping)


def tension_only(stretch, rate, stiffness, damping):
    """Return the tension of a part that cannot push: zero when slack, without a jump when it tightens."""
    return contact(stretch, rate, stiffness, damping)


def transmission_loss(effort, speed, efficiency, v_s):
    """Return the effort lost in a transmission that carries ``effort`` at ``speed``, both on its output side.

    Where power flows towards the output, the input has to supply ``effort / efficiency``; where it flows back, the
    input receives ``efficiency · effort``. Near standstill the loss goes to zero like dry friction
    (``tanh``).
    """
    share = 1.0 / efficiency - 1.0 if effort * speed > 0.0 else 1.0 - efficiency
    return abs(effort) * share * math.tanh(speed / v_s)


def saturated(x, limit):
    """Return x held within ±limit."""
    return max(-limit, min(limit, x))
