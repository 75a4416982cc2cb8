"""The cabin on its guides against MuJoCo: same parameters, the contact law written a second time.

MuJoCo does the rigid body: places and speeds of the shoes, and the acceleration that their forces give.  Its own
contacts are another law (soft constraints), so the forces of Eqs. 3 and 4 are computed here, with SciPy's PCHIP for
the rails, and applied at the sites.  Exudyn integrates a motion in `test_lift_cabin_exudyn`.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation as Turn

from vtsdt.files.parameters import LiftParameters
from vtsdt.lift.lift import Lift

mujoco = pytest.importorskip("mujoco", reason="needs MuJoCo: pip install -e '.[peers]'")

PLACES = ("left_low", "left_high", "right_low", "right_high")


class Peer:
    """MuJoCo's cabin with forces of its own."""

    def __init__(self, parameters: LiftParameters, anchor: float):
        body = parameters.cabin
        self.guide, self.body, self.anchor = parameters.cabin_guide, body, anchor
        sites = {
            f"{side}_{end}": (sign * body.shoe_x, 0.0, height)
            for side, sign in (("left", -1), ("right", 1))
            for end, height in (("low", body.shoe_low), ("high", body.shoe_high))
        }
        sites["hitch"] = (0.0, 0.0, body.hitch)
        told = "".join(f'<site name="{n}" pos="{x!r} {y!r} {z!r}"/>' for n, (x, y, z) in sites.items())
        inertial = (
            f'<inertial mass="{body.mass!r}" pos="{" ".join(map(repr, body.com))}" '
            f'fullinertia="{" ".join(map(repr, body.inertia))} 0 0 0"/>'
        )
        self.model = mujoco.MjModel.from_xml_string(
            f'<mujoco><option gravity="0 0 -9.80665"/><worldbody><body name="cabin">{inertial}<freejoint/>{told}'
            "</body></worldbody></mujoco>"
        )
        self.data = mujoco.MjData(self.model)
        self.sites = {n: mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, n) for n in sites}
        self.rail = PchipInterpolator(self.guide.right_x.height, self.guide.right_x.deviation)

    def acceleration(self, state: np.ndarray, tension: float) -> np.ndarray:
        """Return accelerations of the origin (world axes) and of rotation (body axes)."""
        x, y, z, w = Turn.from_euler("ZYX", state[[5, 4, 3]]).as_quat()
        self.data.qpos[:] = (*state[:3], w, x, y, z)
        self.data.qvel[:] = state[6:]
        self.data.qfrc_applied[:] = 0.0
        mujoco.mj_forward(self.model, self.data)
        for name in PLACES:
            self.push(name, self.force(name))
        way = np.array([0.0, 0.0, self.anchor]) - self.data.site_xpos[self.sites["hitch"]]
        self.push("hitch", tension * way / np.linalg.norm(way))
        mujoco.mj_forward(self.model, self.data)
        return self.data.qacc.copy()

    def push(self, site: str, force: np.ndarray) -> None:
        mujoco.mj_applyFT(
            self.model, self.data, force, np.zeros(3), self.data.site_xpos[self.sites[site]], 1, self.data.qfrc_applied
        )

    def force(self, name: str) -> np.ndarray:
        """State Eqs. 3 and 4 for one shoe."""
        g = self.guide
        at = self.data.site_xpos[self.sites[name]]
        jacobian = np.zeros((3, 6))
        mujoco.mj_jacSite(self.model, self.data, jacobian, None, self.sites[name])
        v = jacobian @ self.data.qvel
        right = name.startswith("right")
        normal = np.array([1.0 if right else -1.0, 0.0, 0.0])
        inside = self.rail.x[0] < at[2] < self.rail.x[-1]  # the rail goes on straight beyond its points
        h = np.clip(at[2], self.rail.x[0], self.rail.x[-1])
        delta, slope = (float(self.rail(h)), float(self.rail(h, 1)) * inside) if right else (0.0, 0.0)
        out, total = np.zeros(3), 0.0
        faces = [
            (normal, (at[0] - normal[0] * self.body.shoe_x) * normal[0] + delta, v[0] * normal[0] + slope * v[2]),
            (np.array([0.0, 1.0, 0.0]), at[1], v[1]),
            (np.array([0.0, -1.0, 0.0]), -at[1], -v[1]),
        ]
        for direction, way, rate in faces:
            depth = way - g.clearance
            if depth <= 0.0:
                continue
            q = np.clip(depth / g.ramp, 0.0, 1.0)
            pressed = max(0.0, g.stiffness * depth + g.damping * (3 * q**2 - 2 * q**3) * rate)
            out -= pressed * direction
            total += pressed
        return out - np.array([0.0, 0.0, g.mu * total * np.tanh(v[2] / g.v_s)])


def test_accelerations_along_a_trip_and_off_it():
    parameters = LiftParameters.bench()
    full = Lift.reference(parameters, profile=True).trip("up", step=0.02)
    lift = Lift.cabin(parameters)
    system, peer = lift.system, Peer(parameters, lift.rim_heights[0])
    rng = np.random.default_rng(11)
    scale = np.array([5e-4] * 2 + [0.05] + [1e-2] * 3 + [0.02] * 2 + [0.2] + [0.1] * 3)
    largest = np.zeros(6)
    wrong = np.zeros(6)
    for row, tension in zip(full.states[:, :12], full["F_c"], strict=True):
        for off in (0.0, 1.0):
            state = row + off * scale * rng.normal(size=12)
            ours = system.rhs(0.0, state, np.array([tension]))[6:]
            theirs = peer.acceleration(state, tension)
            largest = np.maximum(largest, np.abs(theirs))
            wrong = np.maximum(wrong, np.abs(ours - theirs))
    # the asked bar is 1e-5; both solve the same equations, so rounding is all that should differ
    assert np.all(wrong < 1e-9 * largest), wrong / largest
