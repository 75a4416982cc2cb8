"""Laws as plain functions: of force over relative position and speed, shared by translation and rotation; of flows.

Each law of force returns the resisting force (or torque); the components apply it. Equations call these
functions by name, so they are written in the same subset of Python as equations.
"""

from __future__ import annotations

import math

__all__ = [
    "asymmetric",
    "bell",
    "bristle_rate",
    "clearance_contact",
    "contact",
    "coulomb",
    "creep_traction",
    "current_against_drop",
    "leakage",
    "one_sided",
    "pipe_flow",
    "quadratic",
    "radiated",
    "saturated",
    "stribeck",
    "tension_only",
    "transmission_loss",
    "turbulent_flow",
    "voltage_drop",
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


def bell(x, middle, width):
    """Return a bell curve ``exp(-((x - middle)/width)²)``: one at its middle, 1/e at a width from there."""
    s = (x - middle) / width
    return math.exp(-s * s)


def one_sided(v, forward, backward, v_s):
    """Return the factor that goes from ``backward`` to ``forward`` as v passes zero."""
    return 0.5 * (forward + backward) + 0.5 * (forward - backward) * math.tanh(v / v_s)


def bristle_rate(v, z, level, x_s):
    """Return the rate of the deflection z of bristles that give way by ``x_s`` and slide at the deflection ``level``.

    The deflection is over that while sliding.  P. R. Dahl, "A solid friction model", TOR-0158(3107-18)-1, 1968; with a
    level that falls with speed, Canudas de Wit et al., IEEE Transactions on Automatic Control 40 (1995), eq. (1).
    """
    return (v - abs(v) * z / level) / x_s


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


def creep_traction(slip, surface, creep, v_s):
    """Return the traction between two surfaces that creep: the relative slip over ``creep``.

    Well below the limit of friction, the slip of a belt (elastic creep), of a rope on its sheave and of a wheel on its
    track is in proportion to the traction (Johnson, Contact Mechanics, 1985, sec. 8.1; Kalker's linear theory).
    Below the speed ``v_s`` of the driving surface the slip itself is, so that traction is defined at a standstill.
    """
    return slip / (creep * math.sqrt(surface**2 + v_s**2))


def saturated(x, limit):
    """Return x held within ±limit."""
    return max(-limit, min(limit, x))


def voltage_drop(current, drop, i_s):
    """Return the voltage lost against a current: ``drop``, rising in proportion to the current below ``i_s``.

    Brushes of a DC motor; Modelica Standard Library, Electrical.Machines.Losses.DCMachines.Brush (documentation there).
    """
    return drop * saturated(current / i_s, 1.0)


def current_against_drop(voltage, R, drop, i_s):
    """Return the current that a voltage drives through a resistance and a `voltage_drop` in series."""
    low = voltage / (R + drop / i_s)
    return (voltage - math.copysign(drop, voltage)) / R if abs(low) > i_s else low


def turbulent_flow(p, factor, p_s):
    """Return the flow ``factor · √p`` with the sign of p, in proportion to p below about ``p_s``."""
    return factor * p / math.sqrt(math.sqrt(p * p + p_s * p_s))


def leakage(p, laminar, turbulent, p_s):
    """Return the flow through a gap under the pressure p: ``laminar · p`` and ``turbulent · √p``."""
    return laminar * p + turbulent_flow(p, turbulent, p_s)


def pipe_flow(p, resistance, quadratic_loss):
    """Return the flow q for which ``resistance · q + quadratic_loss · q|q|`` is the pressure p."""
    return 2.0 * p / (resistance + math.sqrt(resistance * resistance + 4.0 * quadratic_loss * abs(p)))


def radiated(T, ambient, factor):
    """Return the heat radiated from temperature T to surroundings, ``factor · (T⁴ − ambient⁴)``."""
    return factor * (T**4 - ambient**4)
