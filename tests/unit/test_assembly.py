"""Random machines against a matrix model written independently: modes, deflections, energy, locks, order."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from multibody import Component, Energy, Model, Option, Output, Parameter, Rotation
from multibody.library import Damper, Mass, Spring


class Rotor(Component):
    J = Parameter(1.0, "kg*m**2", "inertia", min=0.0)
    free = Option(True, "False holds it")
    flange = Rotation("shaft", inertia="J")


class Shaft(Component):
    """A torsional spring with damping."""

    k = Parameter(1.0, "N*m/rad", "stiffness")
    c = Parameter(0.0, "N*m*s/rad", "damping")
    a = Rotation("one end")
    b = Rotation("other end")
    torque = Output("N*m", "torque")
    energy = Energy()

    def equations(self):
        twist = self.b.angle - self.a.angle
        self.torque = self.k * twist + self.c * (self.b.speed - self.a.speed)
        self.a.torque = self.torque
        self.b.torque = -self.torque
        self.energy = 0.5 * self.k * twist**2


class Gear(Component):
    """b turns ``ratio`` times as far as a."""

    ratio = Parameter(1.0, "", "turns of b for one of a")
    a = Rotation("one side")
    b = Rotation("other side")

    def coupling(self):
        self.b.angle = self.ratio * self.a.angle

    def coupling_inverse(self):
        self.a.angle = self.b.angle / self.ratio


class Differential(Component):
    """c turns by the weighted sum of a and b."""

    w = Parameter(0.5, "", "weight of a")
    a = Rotation("left")
    b = Rotation("right")
    c = Rotation("sum")

    def coupling(self):
        self.c.angle = self.w * self.a.angle + (1.0 - self.w) * self.b.angle


SIZES = st.floats(0.2, 5.0).map(lambda v: round(v, 3))


@st.composite
def trees(draw):
    """A tree of rotors, joined by shafts or gears, with random values."""
    n = draw(st.integers(1, 6))
    nodes = []
    for k in range(n):
        parent = draw(st.integers(-1, k - 1))
        geared = parent >= 0 and draw(st.booleans())
        nodes.append(
            {
                "parent": parent,
                "geared": geared,
                "J": draw(SIZES),
                "k": draw(SIZES) * 100.0,
                "c": draw(SIZES) * 0.1,
                "ratio": draw(SIZES) * draw(st.sampled_from([1.0, -1.0])),
                "x": draw(st.floats(-0.2, 0.2)),
            }
        )
    return nodes


def tree_model(nodes, order=None, flip=False) -> Model:
    """Return the machine of a tree; ``order`` and ``flip`` change the order of construction, not the machine."""
    model = Model("tree")
    parts, joints = [], []
    for k, node in enumerate(nodes):
        parts.append((f"rotor{k}", Rotor(J=node["J"], angle=node["x"])))
        link = Gear(ratio=node["ratio"]) if node["geared"] else Shaft(k=node["k"], c=node["c"])
        parts.append((f"link{k}", link))
        joints.append((f"link{k}.a", f"rotor{node['parent']}.flange" if node["parent"] >= 0 else "ground"))
        joints.append((f"link{k}.b", f"rotor{k}.flange"))
    if order is not None:
        parts = [parts[i] for i in np.argsort(order[: len(parts)], kind="stable")]
        joints = [joints[i] for i in np.argsort(order[: len(joints)][::-1], kind="stable")]
    for name, part in parts:
        model.add(name, part)
    for first, second in joints:
        model.connect(*((second, first) if flip else (first, second)))
    return model


def matrices(nodes):
    """Return the factors T (angles over independent angles), M, K and C of the tree."""
    factors: list[dict[int, float]] = []
    for k, node in enumerate(nodes):
        factors.append(
            {i: f * node["ratio"] for i, f in factors[node["parent"]].items()} if node["geared"] else {k: 1.0}
        )
    free = [k for k, node in enumerate(nodes) if not node["geared"]]
    t = np.array([[f.get(i, 0.0) for i in free] for f in factors])
    stiffness, damping = np.zeros((len(free),) * 2), np.zeros((len(free),) * 2)
    for k, node in enumerate(nodes):
        if not node["geared"]:
            row = t[k] - (t[node["parent"]] if node["parent"] >= 0 else 0.0)
            stiffness += node["k"] * np.outer(row, row)
            damping += node["c"] * np.outer(row, row)
    mass = t.T @ np.diag([n["J"] for n in nodes]) @ t
    return t, mass, stiffness, damping


def independent(system):
    """Return the indices of angles and speeds that are states, in one order."""
    angles = sorted(system.rate_states)
    return angles, [system.rate_states[a] for a in angles]


@settings(max_examples=40, deadline=None, derandomize=True)
@given(trees())
def test_rates_are_those_of_the_matrix_model(nodes):
    """Whichever side leads, the accelerations of all rotors are those of M q̈ = −K q − C q̇."""
    system = tree_model(nodes).build(compiled=False)
    t, mass, stiffness, damping = matrices(nodes)
    rng = np.random.default_rng(3)
    q, v = rng.normal(size=(2, t.shape[1]))
    angle, speed = t @ q, t @ v
    x = np.array(
        [
            (angle if name.endswith("angle") else speed)[int(name.split(".")[0].removeprefix("rotor"))]
            for name in system.state_names
        ]
    )
    wanted = t @ np.linalg.solve(mass, -stiffness @ q - damping @ v)
    shown = dict(zip(system.output_names, system.outputs_at(0.0, x), strict=True))
    for k in range(len(nodes)):
        assert shown[f"rotor{k}.angle"] == pytest.approx(angle[k], rel=1e-12, abs=1e-12)
        assert shown[f"rotor{k}.speed"] == pytest.approx(speed[k], rel=1e-12, abs=1e-12)
        # conditioning of the mass matrix: ratios up to 25 in a row of five gears
        assert shown[f"rotor{k}.acceleration"] == pytest.approx(wanted[k], rel=1e-7, abs=1e-7 * np.abs(wanted).max())


@settings(max_examples=25, deadline=None, derandomize=True)
@given(trees())
def test_natural_frequencies(nodes):
    undamped = [{**n, "c": 0.0} for n in nodes]
    system = tree_model(undamped).build(compiled=False)
    a = system.jacobian("x", 0.0, system.start)
    _, mass, stiffness, _ = matrices(undamped)
    squared = np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real
    frequencies = np.sort(np.abs(np.linalg.eigvals(a).imag))[::2]
    # the root halves the digits of a small eigenvalue next to a large one
    assert frequencies == pytest.approx(
        np.sort(np.sqrt(np.maximum(squared, 0.0))), rel=1e-5, abs=1e-5 * np.sqrt(squared.max())
    )


@settings(max_examples=25, deadline=None, derandomize=True)
@given(trees(), st.lists(st.integers(0, 1000), min_size=12, max_size=12), st.booleans())
def test_order_does_not_matter(nodes, order, flip):
    """Adding components or connections in another order gives the same motion of every rotor."""
    first, second = (
        tree_model(nodes).build(compiled=False),
        tree_model(nodes, order, flip).build(compiled=False),
    )
    assert sorted(first.output_names) == sorted(second.output_names)
    rng = np.random.default_rng(5)
    t, *_ = matrices(nodes)
    q, v = rng.normal(size=(2, t.shape[1]))
    angle, speed = t @ q, t @ v
    seen = []
    for system in (first, second):
        x = [
            (angle if n.endswith("angle") else speed)[int(n.split(".")[0].removeprefix("rotor"))]
            for n in system.state_names
        ]
        shown = dict(zip(system.output_names, system.outputs_at(0.0, np.array(x)), strict=True))
        seen.append([shown[n] for n in sorted(shown)])
    assert seen[0] == pytest.approx(seen[1], rel=1e-6, abs=1e-6 * max(1.0, np.abs(seen[0]).max()))


@st.composite
def chains(draw):
    n = draw(st.integers(1, 5))
    sizes = st.lists(SIZES, min_size=n, max_size=n)
    return {"m": draw(sizes), "k": draw(sizes), "c": draw(sizes), "force": draw(sizes)}


class Push(Component):
    """A constant force."""

    from multibody import Translation as _Translation

    level = Parameter(1.0, "N", "force")
    flange = _Translation("where it acts")

    def equations(self):
        self.flange.force = self.level


def chain_model(chain, locked=()) -> Model:
    model = Model("chain")
    before = model.ground
    for k in range(len(chain["m"])):
        start = 0.01 * (k + 1)
        body = model.add(f"m{k}", Mass(m=chain["m"][k], position=start, free=k not in locked))
        spring = model.add(f"k{k}", Spring(stiffness=100.0 * chain["k"][k]))
        damper = model.add(f"c{k}", Damper(damping=0.1 * chain["c"][k]))
        push = model.add(f"f{k}", Push(level=chain["force"][k]))
        model.connect(spring.a, damper.a, before)
        model.connect(spring.b, damper.b, body.flange, push.flange)
        before = body.flange
    return model


def chain_stiffness(chain):
    n = len(chain["m"])
    stiffness = np.zeros((n, n))
    for k, value in enumerate(chain["k"]):
        row = np.eye(n)[k] - (np.eye(n)[k - 1] if k else 0.0)
        stiffness += 100.0 * value * np.outer(row, row)
    return stiffness


@settings(max_examples=25, deadline=None, derandomize=True)
@given(chains())
def test_static_deflection(chain):
    system = chain_model(chain).build(compiled=False)
    rest = system.equilibrium()
    wanted = np.linalg.solve(chain_stiffness(chain), chain["force"])
    assert [rest[f"m{k}.position"] for k in range(len(wanted))] == pytest.approx(wanted, rel=1e-8)


@pytest.mark.parametrize("locked", [c for n in range(4) for c in itertools.combinations(range(3), n)])
def test_any_subset_of_free_flags(locked):
    """A locked mass has no states and stays at its start; the others move as in the matrix model."""
    chain = {"m": [1.0, 2.0, 0.5], "k": [1.0, 0.4, 2.0], "c": [1.0, 1.0, 1.0], "force": [1.0, -2.0, 3.0]}
    system = chain_model(chain, locked).build(compiled=False)
    free = [k for k in range(3) if k not in locked]
    assert system.state_names == tuple(f"m{k}.{w}" for k in free for w in ("position", "velocity"))
    start = np.array([0.01, 0.02, 0.03])
    shown = dict(zip(system.output_names, system.outputs_at(0.0, system.start), strict=True))
    assert [shown[f"m{k}.position"] for k in range(3)] == pytest.approx(start)
    wanted = (np.array(chain["force"]) - chain_stiffness(chain) @ start) / chain["m"]
    for k in range(3):
        assert shown[f"m{k}.acceleration"] == pytest.approx(wanted[k] if k in free else 0.0, rel=1e-12)
    run = system.simulate(0.05, method="RK45", step=0.01)
    for k in range(3):
        moved = np.ptp(run[f"m{k}.position"]) > 0.0
        assert moved == (k in free)


def test_locked_mass_of_a_two_inertia_node():
    """A lock on one of two bodies that share a flange holds both."""
    model = Model("m")
    one, two = model.add("one", Rotor(J=1.0)), model.add("two", Rotor(J=2.0, free=False, angle=0.3))
    model.connect(one.flange, two.flange)
    system = model.build(compiled=False)
    assert system.state_names == ()
    assert dict(zip(system.output_names, system.outputs_at(0.0, system.start), strict=True))["one.angle"] == 0.3


def test_inertias_on_one_node_add_up():
    model = Model("m")
    one, two, shaft = (
        model.add("one", Rotor(J=1.0, angle=0.1)),
        model.add("two", Rotor(J=2.0)),
        model.add("shaft", Shaft(k=12.0)),
    )
    model.connect(one.flange, two.flange, shaft.b)
    model.connect(shaft.a, model.ground)
    system = model.build(compiled=False)
    assert system.rhs(0.0, system.start)[1] == pytest.approx(-12.0 * 0.1 / 3.0)


@settings(max_examples=8, deadline=None, derandomize=True)
@given(trees())
def test_energy_is_conserved_without_damping(nodes):
    """Kinetic and elastic energy stay the same over several periods, to the tolerance of the integrator."""
    system = tree_model([{**n, "c": 0.0} for n in nodes]).build(compiled=False)
    run = system.simulate(0.5, method="DOP853", rtol=1e-10, atol=1e-13, step=0.05)
    energy = run["energy.stored"]
    assert energy == pytest.approx(np.full(energy.size, energy[0]), rel=1e-6, abs=1e-12)


def test_differential_with_two_sources():
    """Angles, speeds and accelerations of the third shaft, and the torque it sends back to both."""
    model = Model("m")
    for name, inertia, angle in (("left", 1.0, 0.2), ("right", 2.0, -0.1), ("sum", 3.0, 0.0)):
        model.add(name, Rotor(J=inertia, angle=angle))
    diff, shaft = model.add("diff", Differential(w=0.3)), model.add("shaft", Shaft(k=5.0))
    for port, rotor in (("a", "left"), ("b", "right"), ("c", "sum")):
        model.connect(f"diff.{port}", f"{rotor}.flange")
    del diff
    model.connect(shaft.a, model.ground)
    model.connect(shaft.b, "sum.flange")
    system = model.build(compiled=False)
    t = np.array([[1.0, 0.0], [0.0, 1.0], [0.3, 0.7]])
    mass = t.T @ np.diag([1.0, 2.0, 3.0]) @ t
    q = np.array([0.2, -0.1])
    wanted = t @ np.linalg.solve(mass, -5.0 * t[2] * (t[2] @ q))
    shown = dict(zip(system.output_names, system.outputs_at(0.0, system.start), strict=True))
    assert [shown[f"{n}.acceleration"] for n in ("left", "right", "sum")] == pytest.approx(wanted, rel=1e-12)
