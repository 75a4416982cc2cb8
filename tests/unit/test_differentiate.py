"""Derivatives written from equations are exact: against complex steps, differences, and solutions of
implicit blocks.
"""

from __future__ import annotations

import ast
import cmath
import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from multibody import Component, Input, Model, Option, Output, Parameter, State, Table, Translation, Unknown
from multibody.base.errors import EquationError
from multibody.compile.vector_mode import along_directions
from multibody.equations.differentiate import Differentiator, active_names, d
from multibody.library import Damper, Mass, Spring

STEP = 1e-30  # a complex step has no cancellation, so it can be as small as this


# ------------------------------------------------------------------ complex numbers that follow the real path


class _Math:
    """The functions of ``math`` for complex arguments, with branches decided by the real part."""

    pi = math.pi

    def __getattr__(self, name):
        return getattr(cmath, name)

    @staticmethod
    def fabs(x):
        return x if complex(x).real >= 0 else -x

    @staticmethod
    def floor(x):
        return math.floor(complex(x).real)

    @staticmethod
    def copysign(a, b):
        return _Math.fabs(a) * math.copysign(1.0, complex(b).real)

    @staticmethod
    def hypot(a, b):
        return cmath.sqrt(a * a + b * b)

    @staticmethod
    def pow(a, b):
        return a**b

    @staticmethod
    def atan2(y, x):
        y, x = complex(y), complex(x)
        turn = math.atan2(y.real, x.real)
        slope = (x.real * y.imag - y.real * x.imag) / (x.real**2 + y.real**2)
        return complex(turn, slope)


def _smallest(*values):
    return min(values, key=lambda v: complex(v).real)


def _largest(*values):
    return max(values, key=lambda v: complex(v).real)


class _Real(ast.NodeTransformer):
    """Compare real parts only."""

    def visit_Compare(self, node):
        wrapped = [ast.Call(ast.Name("re", ast.Load()), [self.visit(v)], []) for v in (node.left, *node.comparators)]
        return ast.Compare(wrapped[0], node.ops, wrapped[1:])


def along(text: str, point: dict[str, float], direction: dict[str, float]) -> tuple[float, float]:
    """Return ``y`` and its derivative along a direction, by a complex step through the plain text."""
    tree = ast.fix_missing_locations(_Real().visit(ast.parse(text)))
    space = {
        "math": _Math(),
        "re": lambda v: complex(v).real,
        "abs": _Math.fabs,
        "min": _smallest,
        "max": _largest,
    }
    space |= {k: v + 1j * STEP * direction[k] for k, v in point.items()}
    exec(compile(tree, "<complex>", "exec"), space)
    return complex(space["y"]).real, complex(space["y"]).imag / STEP


def written(text: str, point: dict[str, float], direction: dict[str, float]) -> tuple[float, float]:
    """Return the same from the text that the differentiator writes."""
    nodes = ast.parse(text).body
    tangent = Differentiator(active_names(nodes, set(point)), lambda k: f"{k}_tangent").statements(nodes)
    space: dict = {"math": math, **point, **{d(k): v for k, v in direction.items()}}
    exec(compile(ast.fix_missing_locations(ast.Module(tangent, [])), "<tangent>", "exec"), space)
    return space["y"], space.get(d("y"), 0.0)


def agree(text: str, point: dict[str, float], direction: dict[str, float]) -> None:
    plain: dict = {"math": math, **point}
    try:
        value, slope = along(text, point, direction)
        near = [along(text, {k: v + h * direction[k] for k, v in point.items()}, direction) for h in (1e-9, -1e-9)]
        exec(text, plain)
        got = written(text, point, direction)
    except (ZeroDivisionError, ValueError, OverflowError, TypeError):
        assume(False)  # also where the complex plane has a value and the real line has none, such as a root of -1
    assume(math.isfinite(value) and math.isfinite(slope) and abs(value) < 1e8 and abs(slope) < 1e8)
    assert got[0] == pytest.approx(plain["y"], rel=1e-14, abs=1e-300)
    # at a tie or a jump, rounding decides which branch the complex numbers take: nothing to compare there
    assume(abs(plain["y"] - value) < 1e-9 * (1.0 + abs(value)))
    for shifted, slope_there in near:
        assume(abs(shifted - value) < 1e-7 * (1.0 + abs(slope)))
        assume(abs(slope_there - slope) < 1e-3 * (1.0 + abs(slope)))
    # both are exact up to rounding; conditioning of the expression is what the bound leaves room for
    assert got[1] == pytest.approx(slope, rel=1e-7, abs=1e-7)


NUMBERS = st.floats(-3.0, 3.0).map(lambda v: round(v, 2))
LEAVES = st.one_of(st.sampled_from(["x", "y0", "z"]), st.sampled_from(["1.5", "2.0", "-0.7", "0.25"]))


def _extend(inner):
    unary = st.sampled_from(
        [
            "math.sin({})",
            "math.cos({})",
            "math.exp({})",
            "math.tanh({})",
            "math.atan({})",
            "math.sqrt({} ** 2 + 1.0)",
            "math.log({} ** 2 + 1.0)",
            "math.sinh({})",
            "math.cosh({})",
            "math.tan(0.3 * {})",
            "math.asin(math.tanh({}))",
            "math.acos(0.5 * math.tanh({}))",
            "abs({})",
            "math.fabs({})",
            "-{}",
            "({}) ** 2",
            "({}) ** 3",
            "({}) ** -1",
            "({}) ** 1",
            "({}) ** 0",
            "math.floor({})",
            "abs({}) ** 1.5",
            "abs({}) ** 0.5",
        ]
    )
    binary = st.sampled_from(
        [
            "({} + {})",
            "({} - {})",
            "({} * {})",
            "({} / {})",
            "min({}, {})",
            "max({}, {})",
            "math.hypot({}, {})",
            "math.atan2({}, {})",
            "math.copysign({}, {})",
            "(abs({}) + 0.5) ** {}",
            "math.pow(abs({}) + 0.5, {})",
        ]
    )
    ternary = st.sampled_from(["({} if {} > {} else {})", "max({}, {}, min({}, {}))"])
    return st.one_of(
        st.builds(lambda f, a: f.format(a), unary, inner),
        st.builds(lambda f, a, b: f.format(a, b), binary, inner, inner),
        st.builds(lambda f, a, b, c, e: f.format(a, b, c, e), ternary, inner, inner, inner, inner),
    )


EXPRESSIONS = st.recursive(LEAVES, _extend, max_leaves=8)
POINTS = st.fixed_dictionaries({"x": NUMBERS, "y0": NUMBERS, "z": NUMBERS})


@settings(max_examples=400, deadline=None, derandomize=True)
@given(EXPRESSIONS, POINTS, POINTS)
def test_random_expressions(expression, point, direction):
    agree(f"y = {expression}", point, direction)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(EXPRESSIONS, EXPRESSIONS, EXPRESSIONS, POINTS, POINTS, st.integers(0, 4))
def test_random_programs(a, b, c, point, direction, turns):
    """Branches, loops, accumulation, overwriting and swapping, around random expressions."""
    text = (
        f"y = {a}\n"
        f"if x > {b}:\n    y = y + {c}\n    w = y\nelif y0 < 0.5:\n    w = 2.0\nelse:\n    w = math.sin(y)\n"
        f"for i in range({turns}):\n    y = 0.5 * y + w * math.cos(x) - i\n"
        "y, w = w * y, y\n"
        "y = y + w if w > 0.0 else y - w * z\n"
    )
    agree(text, point, direction)


@pytest.mark.parametrize(
    ("expression", "x", "slope"),
    [
        ("x ** 2", 0.0, 0.0),
        ("x ** 3", 0.0, 0.0),
        ("x ** 1", 0.0, 1.0),
        ("x ** 0", 0.0, 0.0),
        ("x ** 1.5", 0.0, 0.0),
        ("x ** 0.5", 0.0, 0.0),
        ("x ** p", 0.0, 1.0),
        ("math.sqrt(x)", 0.0, 0.0),
        ("math.hypot(x, x)", 0.0, 0.0),
        ("math.atan2(x, x)", 0.0, 0.0),
        ("abs(x)", 0.0, 1.0),
        ("min(x, x)", 1.0, 1.0),
        ("(-2.0) ** 2 * x", 1.0, 4.0),
        ("x % 0.7", 1.0, 1.0),
        ("+x", 1.0, 1.0),
        ("-(-x)", 1.0, 1.0),
        ("x * (x > 0.0)", 2.0, 1.0),
        ("x ** -2", 2.0, -0.25),
    ],
)
def test_special_points(expression, x, slope):
    """Powers and roots at zero are finite, and exponents one and zero are what they should be."""
    text = f"p = 1.0\ny = {expression}"
    nodes = ast.parse(text).body
    tangent = Differentiator(active_names(nodes, {"x"}), str).statements(nodes)
    space = {"math": math, "x": x, d("x"): 1.0}
    exec(compile(ast.fix_missing_locations(ast.Module(tangent, [])), "<tangent>", "exec"), space)
    assert space[d("y")] == pytest.approx(slope, abs=1e-15)


def test_power_of_an_exponent_that_varies():
    for x, p in ((0.0, 2.0), (0.0, 1.0), (2.0, 3.0)):
        value, slope = written("y = x ** p", {"x": x, "p": p}, {"x": 1.0, "p": 0.0})
        assert (value, slope) == (x**p, p * x ** (p - 1))
    assert written("y = x ** p", {"x": 2.0, "p": 3.0}, {"x": 0.0, "p": 1.0})[1] == pytest.approx(8 * math.log(2))


@pytest.mark.parametrize("text", ["y = x % x", "y = {x: 1}", "y = [x]"])
def test_what_has_no_rule_is_refused(text):
    nodes = ast.parse(text).body
    with pytest.raises(EquationError, match="cannot differentiate"):
        Differentiator(active_names(nodes, {"x"}), str).statements(nodes)


# ------------------------------------------------------------------ whole systems against differences


def jacobians_agree(system, x, u=None, p=None, step=1e-6, bound=1e-7):
    """Compare every Jacobian with central differences of fourth order."""
    u, p = system.u if u is None else u, system.p if p is None else p
    for of in ("rhs", "outputs"):
        function = system.rhs if of == "rhs" else system.outputs_at
        for wrt, base in (("x", x), ("u", u), ("p", p)):
            exact = system.jacobian(wrt, 0.3, x, u, p, of=of)
            for k in range(base.size):
                h = step * max(1.0, abs(base[k]))

                def at(shift, wrt=wrt, base=base, k=k, h=h, function=function):
                    moved = base.copy()
                    moved[k] += shift * h
                    vectors = {"x": x, "u": u, "p": p, wrt: moved}
                    return function(0.3, vectors["x"], vectors["u"], vectors["p"])

                near = (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * h)
                scale = np.maximum(1.0, np.abs(exact[:, k]))
                assert np.all(np.abs(exact[:, k] - near) <= bound * scale), (of, wrt, k)


def stribeck(v, level, peak, width):
    if abs(v) < 1e-9:
        return 0.0, 0.0
    side = 1.0 if v > 0.0 else -1.0
    curve = level + (peak - level) * math.exp(-((v / width) ** 2))
    return side * curve, curve * abs(v)


def doubled(x):
    return 2.0 * inner(x) + x


def inner(x):
    total = 0.0
    for k in range(3):
        total = total + x**k / (k + 1)
    return total


class Everything(Component):
    """Uses all that the subset has."""

    level = Parameter(2.0, "N", "level of friction")
    peak = Parameter(3.0, "N", "peak of friction")
    width = Parameter(0.4, "m/s", "width of the peak")
    power = Parameter(1.7, "", "exponent")
    linear = Table("m", "N", "stepped force", default=([-1.0, 0.0, 0.5, 2.0], [0.0, 1.0, 4.0, 3.0]))
    smooth = Table("m", "N", "smooth force", "cubic", ([-1.0, 0.0, 0.5, 2.0], [0.0, 1.0, 4.0, 3.0]))
    terms = Option(3, "terms", choices=(2, 3))
    u = Input("N", "push")
    s = State("m", "lag")
    y = Output("N", "result")
    loss = Output("W", "loss")
    flange = Translation("shaft")

    def equations(self):
        v = self.flange.velocity
        friction, self.loss = stribeck(v, self.level, self.peak, self.width)
        force = self.linear(self.flange.position) + self.smooth(0.5 * self.flange.position + self.s)
        for k in range(self.terms):
            force += math.sin(k * self.flange.position) * doubled(self.s)
        if self.flange.position > 0.2 and not self.s < 0.0:
            force -= abs(v) ** self.power
        elif self.s > 5.0:
            force = 0.0
        self.y = force + min(self.u, 4.0 * self.time, max(self.s, 1.0))
        self.flange.force = self.y - friction
        self.der.s = (self.flange.position - self.s) / (0.1 + self.width)


def everything():
    model = Model("m")
    model.add("body", Mass(m=1.3))
    part = model.add("part", Everything())
    model.input("u", part.u)
    model.connect(part.flange, "body.flange")
    return model


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("x", [(0.33, 0.21, 0.1), (-0.4, -0.5, 0.72), (3.0, 0.9, 1.2), (-1.5, 0.7, 0.3)])
def test_a_system_that_uses_the_whole_subset(x, compiled):
    system = everything().build(compiled=compiled)
    order = [system.index("state", n) for n in ("body.position", "body.velocity", "part.s")]
    state = np.empty(3)
    state[order] = x
    jacobians_agree(system, state, np.array([0.7]), bound=2e-7)


class QuadraticDamper(Component):
    """Force that grows with speed and its third power: an implicit block that is not affine."""

    c = Parameter(1.0, "N*s/m", "linear part")
    c3 = Parameter(0.5, "N*s**3/m**3", "cubic part")
    a = Translation("one end")
    b = Translation("other end")
    force = Output("N", "force")

    def equations(self):
        v = self.b.velocity - self.a.velocity
        self.force = self.c * v + self.c3 * v**3
        self.a.force = self.force
        self.b.force = -self.force


class TableDamper(Component):
    curve = Table("m/s", "N", "force", "cubic", ([-2.0, -1.0, 0.0, 1.0, 2.0], [-5.0, -2.0, 0.0, 2.0, 5.0]))
    a = Translation("one end")
    b = Translation("other end")

    def equations(self):
        force = self.curve(self.b.velocity - self.a.velocity)
        self.a.force = force
        self.b.force = -force


def chain_without_masses(damper: Component, nodes: int) -> Model:
    """Return springs to the ground at nodes that dampers join; one mass at the end."""
    model = Model("m")
    model.add("mass", Mass(m=1.0, position=0.3, velocity=0.4))
    for k in range(nodes):
        spring, ground = (
            model.add(f"spring{k}", Spring(stiffness=3.0 + k)),
            model.add(f"base{k}", Damper(damping=0.4)),
        )
        link = model.add(f"link{k}", damper.copy())
        model.connect(spring.a, ground.a, model.ground)
        model.connect(spring.b, ground.b, link.a)
        model.output(f"v{k}", f"spring{k}.b.velocity")
        model.connect(link.b, f"spring{k + 1}.b" if k + 1 < nodes else "mass.flange")
    return model


@pytest.mark.parametrize("damper", [Damper(damping=0.7), QuadraticDamper(), TableDamper(), None])
def test_several_directions_through_implicit_blocks_and_the_whole_subset(damper):
    system = (everything() if damper is None else chain_without_masses(damper, 2)).build()
    wide = along_directions(system.rhs_tangent, 5)
    assert wide is not None
    rng, n = np.random.default_rng(0), len(system.states)
    x = system.start + 0.1 * np.arange(1, n + 1)
    directions = [rng.standard_normal((size, 5)) for size in (n, system.u.size, system.p.size)]
    out = wide(0.0, x, system.u, system.p, *directions, np.empty((n, 5)))
    for j in range(5):
        each = (np.ascontiguousarray(d[:, j]) for d in directions)
        one = system.rhs_tangent(0.0, x, system.u, system.p, *each, np.empty(n))
        np.testing.assert_allclose(out[:, j], one, rtol=1e-12, atol=1e-12 * np.abs(one).max())


@pytest.mark.parametrize("nodes", [1, 2, 3])
@pytest.mark.parametrize(
    "damper", [Damper(damping=0.7), QuadraticDamper(), TableDamper()], ids=lambda c: type(c).__name__
)
def test_implicit_blocks(damper, nodes):
    """The rates of the solved block, and its tangent against differences of the solution."""
    system = chain_without_masses(damper, nodes).build(compiled=False)
    x = system.start + 0.1 * np.arange(1, system.start.size + 1)
    jacobians_agree(system, x, bound=1e-6)
    shown = dict(zip(system.output_names, system.outputs_at(0.0, x), strict=True))
    speeds = [shown[f"v{k}"] for k in range(nodes)] + [shown["mass.velocity"]]
    forces = [0.0] + [law(damper, after - before) for before, after in itertools.pairwise(speeds)]
    for k in range(nodes):  # what acts on every node sums to zero
        rest = forces[k + 1] - forces[k] - shown[f"spring{k}.tension"] - shown[f"base{k}.tension"]
        assert abs(rest) < 1e-11


def law(damper: Component, v: float) -> float:
    """Return the force of a damper, written a second time."""
    if isinstance(damper, QuadraticDamper):
        return v + 0.5 * v**3
    if isinstance(damper, TableDamper):
        from scipy.interpolate import PchipInterpolator

        x, y = damper.tables["curve"]
        return float(PchipInterpolator(x, y)(np.clip(v, x[0], x[-1])))
    return 0.7 * v


class Root(Component):
    """A declared unknown with the equation z³ + z = x."""

    z = Unknown("m", "solves the cubic")
    flange = Translation("shaft")

    def equations(self):
        self.zero.z = self.z**3 + self.z - self.flange.position
        self.flange.force = -self.z


class NoRoot(Component):
    z = Unknown("m", "has no value")
    flange = Translation("shaft")

    def equations(self):
        self.zero.z = self.z**2 + self.z + 1.0 + self.flange.position**2
        self.flange.force = -self.z


def one(component: Component) -> Model:
    model = Model("m")
    model.add("body", Mass(m=2.0, position=10.0))
    model.connect(model.add("part", component).flange, "body.flange")
    return model


def test_declared_unknown():
    system = one(Root()).build(compiled=False)
    assert system.rhs(0.0, system.start)[1] == pytest.approx(-1.0, abs=1e-14)  # z = 2 solves z³ + z = 10
    assert system.jacobian("x", 0.0, system.start)[1, 0] == pytest.approx(-0.5 / 13.0, rel=1e-12)  # dz/dx = 1/(3z²+1)
    jacobians_agree(system, system.start)


@pytest.mark.parametrize("compiled", [True, False])
def test_unknown_without_a_solution_is_not_a_number(compiled):
    system = one(NoRoot()).build(compiled=compiled)
    assert math.isnan(system.rhs(0.0, system.start)[1])


def test_sparsity_covers_the_jacobian():
    system = everything().build(compiled=False)
    rng = np.random.default_rng(1)
    for _ in range(20):
        jacobian = system.jacobian("x", 0.0, rng.normal(size=3), np.ones(1))
        assert not np.any((jacobian != 0.0) & ~system.sparsity)
