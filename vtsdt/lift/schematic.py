"""A lift drawn from the front: rails with their deviation, cabin, counterweight, ropes, pulley and support."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from vtsdt.files.parameters import BodyParameters, GuideParameters
    from vtsdt.lift.lift import Lift

__all__ = ["Schematic"]

_SIDES = ("cabin", "counterweight")
_COLOURS = {"cabin": "tab:blue", "counterweight": "tab:brown"}


class Schematic:
    """The drawing of a lift in axes, moved by `show`.

    Parameters
    ----------
    lift : Lift
    axes : matplotlib axes
    exaggeration : float
        Factor on lateral motion, tilt and rail deviation; vertical motion is to scale.
    """

    def __init__(self, lift: Lift, axes: Any, exaggeration: float = 20.0):
        self.lift, self.axes, self.factor = lift, axes, exaggeration
        p = lift.parameters
        self.centre = {"cabin": 0.0, "counterweight": p.cabin.shoe_x + p.counterweight.shoe_x + 0.25}
        self.sides = [s for s in _SIDES if s in lift.components]
        self.top = p.hoistway.rail_top + 0.45
        for side in self.sides:
            self._rails(self.centre[side], getattr(p, side), getattr(p, f"{side}_guide"))
        self.boxes = {s: axes.fill([0], [0], color=_COLOURS[s], alpha=0.5)[0] for s in self.sides}
        self.ropes = {s: axes.plot([], [], color="black", linewidth=1.0)[0] for s in self.sides}
        self.plate = axes.plot([], [], color="dimgray", linewidth=4.0)[0]
        self.spoke = axes.plot([], [], "-o", color="tab:red", markersize=3)[0]
        axes.set_aspect("equal")
        axes.set_xlabel(f"x [m], lateral motion × {exaggeration:g}")
        axes.set_ylabel("height [m]")
        width = p.cabin.shoe_x + 0.15
        axes.set_xlim(
            -width,
            (self.centre["counterweight"] + p.counterweight.shoe_x + 0.15) if "counterweight" in self.sides else width,
        )
        axes.set_ylim(p.hoistway.rail_bottom - 0.1, self.top + 0.4)

    def _rails(self, centre: float, body: BodyParameters, guide: GuideParameters) -> None:
        hoistway = self.lift.parameters.hoistway
        heights = np.linspace(hoistway.rail_bottom, hoistway.rail_top, 200)
        for sign, profile in ((-1.0, guide.left_x), (1.0, guide.right_x)):
            deviation = np.array([profile.at(h) for h in heights]) if profile else np.zeros(heights.size)
            at = centre + sign * (body.shoe_x + 0.02) - sign * self.factor * deviation
            self.axes.plot(at, heights, color="gray", linewidth=2.0)

    def show(self, state: Mapping[str, float], angle: float | None = None) -> list[Any]:
        """Draw a state (by name); parts without a state in the model do not move.  Returns the artists."""
        p = self.lift.parameters
        sag = state.get("support.plate_position", state.get("support.position", 0.0))
        tilt = state.get("support.tilt_B_angle", 0.0)
        ends = []
        for side in self.sides:
            body = getattr(p, side)
            x = self.centre[side] + self.factor * state.get(f"{side}.x", 0.0)
            pitch = self.factor * state.get(f"{side}.pitch", 0.0)
            z = state.get(f"{side}.z", 0.0)
            c, s = math.cos(pitch), math.sin(pitch)

            half, high = 0.9 * body.shoe_x, body.shoe_high
            corners = np.array([(-half, 0.0), (half, 0.0), (half, high), (-half, high), (0.0, body.hitch)])
            *box, hitch = np.array([x, z]) + corners @ np.array([[c, -s], [s, c]])
            self.boxes[side].set_xy(box)
            upper = (self.centre[side], self.top + self.factor * sag)
            self.ropes[side].set_data(*zip(hitch, upper, strict=True))
            ends.append(upper[0])
        middle, half = 0.5 * (min(ends) + max(ends)), 0.5 * (max(ends) - min(ends)) + 0.15
        rise = math.tan(self.factor * tilt) * half
        height = self.top + self.factor * sag + 0.05
        self.plate.set_data([middle - half, middle + half], [height + rise, height - rise])
        turn = -state.get("pulley.angle", 0.0) if angle is None else angle
        self.spoke.set_data(
            [middle, middle + p.pulley.R_p * math.sin(turn)],
            [height + 0.1, height + 0.1 + p.pulley.R_p * math.cos(turn)],
        )
        return [*self.boxes.values(), *self.ropes.values(), self.plate, self.spoke]
