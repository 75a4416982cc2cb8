"""The cabin on its guides against Exudyn: a motion of half a second, integrated by each program on its own.

Exudyn does the rigid body and the integration (Runge-Kutta 4); the forces of
Eqs. 3 and 4 and of the rope act on markers, stated here a second time with SciPy's PCHIP for the rails.  The peer is
built from the same parameter object as ours.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation as Turn

from vtsdt.files.parameters import LiftParameters
from vtsdt.lift.lift import Lift

exudyn = pytest.importorskip("exudyn", reason="needs Exudyn: pip install -e '.[peers]'")
pytest.importorskip("exudyn.utilities")

STEP, UNTIL = 1e-4, 0.5
CORNERS = [("left", "low"), ("left", "high"), ("right", "low"), ("right", "high")]


def tension(parameters: LiftParameters, t: float) -> float:
    """Return a rope tension that moves the cabin up and down a little."""
    return parameters.cabin.mass * 9.80665 + 4.0 * float(np.sin(2.0 * np.pi * 3.0 * t))


class Peer:
    """Exudyn's cabin with forces of its own."""

    def __init__(self, parameters: LiftParameters, anchor: float, state: np.ndarray) -> None:
        self.parameters, self.guide = parameters, parameters.cabin_guide
        body = parameters.cabin
        self.container = exudyn.SystemContainer()
        self.mbs = self.container.AddSystem()
        com, mass = np.array(body.com), body.mass
        about_origin = np.diag(body.inertia) + mass * (com @ com * np.eye(3) - np.outer(com, com))
        turn = Turn.from_euler("ZYX", state[[5, 4, 3]]).as_matrix()
        made: dict[str, Any] = self.mbs.CreateRigidBody(
            referencePosition=list(state[:3]),
            referenceRotationMatrix=turn,
            initialVelocity=list(state[6:9]),
            initialAngularVelocity=list(turn @ state[9:12]),  # Exudyn takes it in world axes
            inertia=exudyn.utilities.RigidBodyInertia(mass=mass, inertiaTensor=about_origin, com=list(com)),
            gravity=[0.0, 0.0, -9.80665],
            nodeType=exudyn.NodeType.RotationRxyz,
            returnDict=True,
        )
        self.node, number = made["nodeNumber"], made["bodyNumber"]
        self.rail = PchipInterpolator(self.guide.right_x.height, self.guide.right_x.deviation)
        for side, end in CORNERS:
            way = 1.0 if side == "right" else -1.0
            place = [way * body.shoe_x, 0.0, body.shoe_high if end == "high" else body.shoe_low]
            marker = self.marker(number, place)
            self.load(marker, lambda mbs, t, load, m=marker, w=way: list(self.shoe(m, w)))
        hitch = self.marker(number, [0.0, 0.0, body.hitch])

        def rope(mbs: Any, t: float, load: list[float]) -> list[float]:
            way = np.array([0.0, 0.0, anchor]) - self.where(hitch)
            return list(tension(parameters, t) * way / np.linalg.norm(way))

        self.load(hitch, rope)
        self.mbs.Assemble()

    def marker(self, body: int, place: list[float]) -> int:
        return int(self.mbs.AddMarker(exudyn.itemInterface.MarkerBodyPosition(bodyNumber=body, localPosition=place)))

    def load(self, marker: int, function: Any) -> None:
        self.mbs.AddLoad(
            exudyn.itemInterface.LoadForceVector(
                markerNumber=marker, loadVector=[0.0, 0.0, 0.0], loadVectorUserFunction=function
            )
        )

    def where(self, marker: int, what: Any = None) -> np.ndarray:
        return np.array(self.mbs.GetMarkerOutput(marker, what or exudyn.OutputVariableType.Position))

    def shoe(self, marker: int, way: float) -> np.ndarray:
        """State Eqs. 3 and 4 for one shoe."""
        g = self.guide
        at, v = self.where(marker), self.where(marker, exudyn.OutputVariableType.Velocity)
        delta, slope = (float(self.rail(at[2])), float(self.rail(at[2], 1))) if way > 0.0 else (0.0, 0.0)
        out, total = np.zeros(3), 0.0
        faces = (
            (np.array([way, 0.0, 0.0]), way * at[0] - self.parameters.cabin.shoe_x + delta, way * v[0] + slope * v[2]),
            (np.array([0.0, 1.0, 0.0]), at[1], v[1]),
            (np.array([0.0, -1.0, 0.0]), -at[1], -v[1]),
        )
        for direction, pressed_in, rate in faces:
            depth = pressed_in - g.clearance
            if depth <= 0.0:
                continue
            q = min(depth / g.ramp, 1.0)
            pressed = max(0.0, g.stiffness * depth + g.damping * (3 * q**2 - 2 * q**3) * rate)
            out -= pressed * direction
            total += pressed
        return out - np.array([0.0, 0.0, g.mu * total * np.tanh(v[2] / g.v_s)])

    def run(self) -> dict[str, np.ndarray]:
        """Integrate and return accelerations of the origin and of rotation (world axes) over time."""
        kinds = {
            "z": exudyn.OutputVariableType.Position,
            "linear": exudyn.OutputVariableType.Acceleration,
            "angular": exudyn.OutputVariableType.AngularAcceleration,
        }
        sensors = {
            n: self.mbs.AddSensor(
                exudyn.itemInterface.SensorNode(
                    nodeNumber=self.node, storeInternal=True, writeToFile=False, outputVariableType=kind
                )
            )
            for n, kind in kinds.items()
        }
        self.mbs.Assemble()
        settings = exudyn.SimulationSettings()
        settings.timeIntegration.numberOfSteps = round(UNTIL / STEP)
        settings.timeIntegration.endTime = UNTIL
        settings.timeIntegration.verboseMode = 0
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = 0.005
        self.mbs.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.RK44)
        return {n: np.array(self.mbs.GetSensorStoredData(s)) for n, s in sensors.items()}


def test_accelerations_of_half_a_second_of_motion() -> None:
    parameters = LiftParameters.bench()
    lift = Lift.cabin(parameters)
    system = lift.system
    start = lift.equilibrium(0.3, inputs={"F_c": parameters.cabin.mass * 9.80665}).state
    # moving up past misaligned rail, and shaken sideways and about all axes
    start = start + np.array([3e-4, -2e-4, 0.0, 5e-4, -4e-4, 3e-4, 0.01, -0.02, 0.3, 0.03, -0.02, 0.04])
    theirs = Peer(parameters, lift.rim_heights[0], start).run()
    t = theirs["z"][:, 0]
    assert t.size == 101
    # short steps: where a flange touches, accelerations feel the error of positions 1e4 times
    ours = system.simulate(
        UNTIL,
        inputs={"F_c": lambda s: tension(parameters, s)},
        initial=start,
        times=t,
        method="DOP853",
        rtol=1e-11,
        atol=1e-14,
        max_step=2e-4,
    )
    rates = np.array(
        [system.rhs(s, x, np.array([tension(parameters, s)])) for s, x in zip(t, ours.states, strict=True)]
    )
    turns = Turn.from_euler("ZYX", ours.states[:, [5, 4, 3]])
    rates[:, 9:12] = turns.apply(rates[:, 9:12])  # from body to world axes
    assert np.abs(theirs["z"][:, 3] - ours["cabin.z"]).max() < 1e-8
    assert np.ptp(ours["cabin.z"]) > 0.1
    for part, columns in (("linear", slice(6, 9)), ("angular", slice(9, 12))):
        wrong = np.abs(theirs[part][1:, 1:4] - rates[1:, columns]).max(axis=0)
        largest = np.abs(rates[:, columns]).max(axis=0)
        assert np.all(wrong < 1e-5 * largest), (part, wrong / largest)
