"""Equations outside the subset are refused with component, file, line and remedy; what is inside means the
same.
"""

from __future__ import annotations

import itertools
import math
import re
import subprocess
import sys
import textwrap

import numpy as np
import pytest

from multibody import Component, Model, ModelError, Option, Output, Parameter, State, Table, Translation
from multibody.equations.rewriter import simplified
from multibody.equations.statements import readable, variable
from multibody.library import Mass

FACTOR = np.float64(-2.0)
COUNT = np.int64(3)
NAMES = ["a", "b"]


class Part(Component):
    """Base of the components below: a curve, an option, a number, a state and an output."""

    k = Parameter(3.0, "N/m", "stiffness")
    mode = Option("soft", "kind of law", choices=("soft", "hard", "none"))
    order = Option(2, "number of terms", choices=(0, 1, 2, 3))
    curve = Table("m", "N", "force", default=([0.0, 1.0], [0.0, 1.0]))
    flange = Translation("shaft")
    s = State("m", "follows the shaft")
    y = Output("N", "result")

    def rest(self):
        """Stand for what every component has to assign."""


def built(cls: type[Component], **options):
    model = Model("m")
    model.add("body", Mass(m=1.0, position=0.5, velocity=-0.25))
    part = model.add("part", cls(**options))
    model.connect(part.flange, "body.flange")
    return model.build(compiled=False)


def refused(cls: type[Component]) -> str:
    with pytest.raises(ModelError) as caught:
        built(cls)
    assert len(caught.value.faults) == 1, caught.value.faults
    return caught.value.faults[0]


def made(body: str, tmp_path, rest: str = "") -> type[Component]:
    """Return a component class whose equations are the given lines, defined in a file of its own."""
    lines = textwrap.indent(textwrap.dedent(body), " " * 8)
    text = (
        "import math\nimport numpy as np\nfrom test_equation_subset_base import FACTOR, COUNT, NAMES, Part\n"
        f"{textwrap.dedent(rest)}\n\nclass Made(Part):\n    def equations(self):\n{lines}\n"
    )
    file = tmp_path / "machine.py"
    file.write_text(text)
    sys.modules["test_equation_subset_base"] = sys.modules[__name__]
    space: dict = {"__name__": "machine"}
    exec(compile(text, str(file), "exec"), space)
    module = type(sys)("machine")
    module.__dict__.update(space)
    module.__file__ = str(file)
    sys.modules["machine"] = module
    return space["Made"]


GOOD = "\nself.y = 1.0\nself.der.s = 0.0"

REFUSED = {
    "list comprehension": ("self.y = [x for x in (1, 2)][0]\nself.der.s = 0.0", "outside the subset"),
    "attribute of another object": (
        "self.y = NAMES.size\nself.der.s = 0.0",
        "only attributes of self and of math",
    ),
    "try": (
        "try:\n    self.y = 1.0\nexcept ValueError:\n    self.y = 2.0\nself.der.s = 0.0",
        "try is outside",
    ),
    "while": ("while self.s > 0.0:\n    self.y = 1.0\n" + GOOD, "while is outside the subset"),
    "keyword call": ("self.y = math.atan2(y=1.0, x=2.0)\nself.der.s = 0.0", "plain positional arguments"),
    "starred call": ("self.y = max(*NAMES)\nself.der.s = 0.0", "plain positional arguments"),
    "string": ("name = 'text'" + GOOD, "'text' is not a number"),
    "f-string": ("name = f'{self.s}'" + GOOD, "a text is outside"),
    "none": ("name = None" + GOOD, "None is not a number"),
    "complex": ("name = 1j" + GOOD, "is not a number"),
    "unknown function": ("self.y = curvature(self.s)\nself.der.s = 0.0", "can be called"),
    "numpy function": ("self.y = np.sin(self.s)\nself.der.s = 0.0", "write math.sin"),
    "unknown math function": ("self.y = math.gamma(self.s)\nself.der.s = 0.0", "math.gamma is not available"),
    "number of arguments": (
        "self.y = math.sin(self.s, 2.0)\nself.der.s = 0.0",
        "called with 2 arguments, and must have 1",
    ),
    "abs of two": ("self.y = abs(self.s, 2.0)\nself.der.s = 0.0", "called with 2 arguments"),
    "max of one": ("self.y = max(self.s)\nself.der.s = 0.0", "called with 1 argument, and must have 2 or more"),
    "undefined name": ("self.y = stiffness * self.s\nself.der.s = 0.0", "'stiffness' is not defined"),
    "name that is a list": (
        "self.y = NAMES\nself.der.s = 0.0",
        "'NAMES' is a list: equations can use numbers only",
    ),
    "undeclared": ("self.y = self.stifness\nself.der.s = 0.0", "'self.stifness' is not declared"),
    "misspelt": ("self.y = self.curv(self.s)\nself.der.s = 0.0", "only a declared table can be called"),
    "port without quantity": ("self.y = self.flange\nself.der.s = 0.0", "used by its quantities"),
    "unknown port quantity": ("self.y = self.flange.velocty\nself.der.s = 0.0", "did you mean 'velocity'?"),
    "table as number": ("self.y = self.curve\nself.der.s = 0.0", "used by calling it"),
    "two arguments to a table": ("self.y = self.curve(1.0, 2.0)\nself.der.s = 0.0", "with one argument"),
    "rate of no state": ("self.der.y = 1.0" + GOOD, "not the rate of a declared state"),
    "equation of no unknown": ("self.zero.y = 1.0" + GOOD, "not the equation of a declared unknown"),
    "assigned parameter": ("self.k = 1.0" + GOOD, "a parameter cannot be assigned"),
    "assigned option": ("self.order = 1" + GOOD, "an option cannot be assigned"),
    "assigned state": ("self.s = 1.0" + GOOD, "its rate is: self.der.s"),
    "assigned motion": ("self.flange.position = 1.0" + GOOD, "prescribed=True"),
    "assigned reaction": ("self.flange.reaction = 1.0" + GOOD, "follows from the others"),
    "assigned time": ("self.time = 1.0" + GOOD, "time cannot be assigned"),
    "two names": ("a = b = 1.0" + GOOD, "assign to one name at a time"),
    "uneven tuple": ("a, b = 1.0, 2.0, 3.0" + GOOD, "3 expressions for 2 names"),
    "tuple in one name": ("a = 1.0, 2.0" + GOOD, "cannot hold several values"),
    "walrus": ("self.y = (a := self.s)\nself.der.s = 0.0", "':=' is outside"),
    "lambda": ("f = lambda x: x" + GOOD, "lambda is outside"),
    "inner function": ("def f(x):\n    return x" + GOOD, "a function inside the equations"),
    "return": ("self.y = 1.0\nself.der.s = 0.0\nreturn", "return is outside"),
    "assert": ("assert self.s > 0.0" + GOOD, "assert is outside"),
    "import": ("import math as m" + GOOD, "import is outside"),
    "delete": ("a = 1.0\ndel a" + GOOD, "del is outside"),
    "index": ("self.y = NAMES[0]\nself.der.s = 0.0", "an index is outside"),
    "bare call": ("math.sin(self.s)" + GOOD, "a line must assign something"),
    "floor division": ("self.y = self.s // 2.0\nself.der.s = 0.0", "operator is outside"),
    "bits": ("self.y = ~COUNT\nself.der.s = 0.0", "outside the subset"),
    "loop over names": ("for n in NAMES:\n    pass" + GOOD, "a loop must be 'for i in range(...)'"),
    "loop of unknown length": ("for i in range(self.s):\n    pass" + GOOD, "whole number or an option"),
    "loop with else": ("for i in range(2):\n    a = 1.0\nelse:\n    a = 2.0" + GOOD, "has no 'else'"),
    "or of numbers": ("self.y = self.s or self.k\nself.der.s = 0.0", "join conditions, not numbers"),
    "text compared with a state": (
        "self.y = 1.0 if self.s == 'a' else 2.0\nself.der.s = 0.0",
        "compared with an option",
    ),
    "in for a state": ("self.y = 1.0 if self.s in (1.0, 2.0) else 2.0\nself.der.s = 0.0", "'in' and 'is'"),
    "own abs": ("abs = 1.0" + GOOD, "is the name of a function"),
    "math renamed": ("math = 1.0" + GOOD, "'math' is the name of a function"),
    "not a number constant": ("self.y = math.nan\nself.der.s = 0.0", "only attributes of self and of math"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_outside_the_subset(case, tmp_path):
    body, words = REFUSED[case]
    message = refused(made(body, tmp_path))
    assert words in message
    assert re.match(r"part \(Made, machine\.py:\d+\): ", message)


def test_the_line_is_that_of_the_fault(tmp_path):
    message = refused(made("a = 1.0\nb = 2.0\nself.y = a + wrong\nself.der.s = 0.0", tmp_path))
    line = int(re.search(r"machine\.py:(\d+)", message)[1])
    assert (tmp_path / "machine.py").read_text().splitlines()[line - 1].strip() == "self.y = a + wrong"


def test_every_line_at_fault_is_reported(tmp_path):
    with pytest.raises(ModelError) as caught:
        built(made("self.y = wrong\nself.der.s = alsowrong\nself.k = 1.0", tmp_path))
    assert [w in f for w, f in zip(("'wrong'", "'alsowrong'", "'k'"), caught.value.faults, strict=False)][:2] == [
        True
    ] * 2
    assert len(caught.value.faults) == 3


@pytest.mark.parametrize(
    "last", ["self.y = 2.0 * self.s", "if self.s > 0.0:\n    self.y = 1.0\nelse:\n    self.y = 2.0"]
)
def test_a_value_that_is_replaced_before_anything_uses_it(last, tmp_path):
    message = refused(made(f"self.y = self.s\nself.der.s = 0.0\n{last}", tmp_path))
    assert "part (Made, machine.py:" in message
    assert "'self.y' gets a second value, and nothing uses the first (machine.py:8)" in message


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ("self.y += 1.0", 4.0),
        ("self.y = 2.0 * self.y", 6.0),
        ("if self.s < 1.0:\n    self.y = 1.0", 1.0),
        ("for k in range(3):\n    self.y = self.y + 1.0", 6.0),
    ],
)
def test_a_value_that_is_continued(more, expected, tmp_path):
    assert value_of(made(f"self.y = 3.0\n{more}\nself.der.s = 0.0", tmp_path)) == pytest.approx(expected)


KERNELS = {
    "no return": ("def law(x):\n    y = x\n", "must return on every path"),
    "return in one branch": ("def law(x):\n    if x > 0.0:\n        return x\n", "must return on every path"),
    "empty return": ("def law(x):\n    return\n", "returns a number"),
    "half assigned": (
        "def law(x):\n    if x > 0.0:\n        y = x\n    return y\n",
        "'y' may be used before",
    ),
    "uneven results": (
        "def law(x):\n    if x > 0.0:\n        return x, x\n    return x\n",
        "same number of values",
    ),
    "two results": ("def law(x):\n    return x, x\n", "returns 2 values, taken by 1 names"),
    "default": ("def law(x, y=1.0):\n    return x * y\n", "called with 1 argument, and must have 2"),
    "more arguments": ("def law(x, *more):\n    return 1.0\n", "plain positional arguments only"),
    "underscore": ("def law(x):\n    _d_x = x\n    return _d_x\n", "begins with an underscore"),
    "shadowed function": ("def law(x):\n    max = x\n    return max\n", "is the name of a function"),
    "attribute": ("def law(x):\n    return x.real\n", "only attributes of self and of math"),
    "itself": ("def law(x):\n    return law(x - 1.0)\n", "circle: f_machine_law → f_machine_law"),
}


@pytest.mark.parametrize("case", KERNELS)
def test_function_outside_the_subset(case, tmp_path):
    text, words = KERNELS[case]
    message = refused(made("self.y = law(self.s)\nself.der.s = 0.0", tmp_path, text))
    assert words in message
    assert "law" in message


def test_class_whose_source_cannot_be_read():
    space: dict = {"Part": Part}
    exec("class Made(Part):\n    def equations(self):\n        self.y = 1.0\n        self.der.s = 0.0\n", space)
    message = refused(space["Made"])
    assert "component 'part'" in message
    assert "cannot be read: define the class in a file" in message


def test_equations_that_are_a_lambda():
    class Short(Part):
        equations = lambda self: None  # noqa: E731

    assert "write it with def" in refused(Short)


# ------------------------------------------------------------------ what is inside means what Python means


def negative_power(x):
    return x**FACTOR


def whole_numbers(x):
    half = 1 / 2
    power = 2**-1
    return half + power + x * COUNT


def branches(x, y):
    if x > y:
        return x, 1.0
    low = y
    return low, -1.0


def make_law(slope):
    def law(x):
        return slope * x

    return law


steep, flat = make_law(5.0), make_law(7.0)


def value_of(cls: type[Component], **options) -> float:
    system = built(cls, **options)
    y = system.outputs_at(0.0, system.start)
    return float(y[system.index("output", "part.y")])


def test_negative_constants_keep_their_sign():
    class Negative(Part):
        def equations(self):
            self.y = FACTOR**2 + negative_power(2.0) - -FACTOR
            self.der.s = 0.0

    assert value_of(Negative) == 4.0 + 0.25 - 2.0


def test_whole_numbers_are_numbers_like_others():
    class Whole(Part):
        def equations(self):
            self.y = whole_numbers(1) + 1 / 4 + COUNT
            self.der.s = 0.0

    assert value_of(Whole) == 0.5 + 0.5 + 3 + 0.25 + 3


def test_functions_of_the_same_name_are_kept_apart():
    class Two(Part):
        def equations(self):
            self.y = steep(1.0) + 10.0 * flat(1.0)
            self.der.s = 0.0

    assert value_of(Two) == 75.0


def test_augmented_assignment_accumulates():
    class Sum(Part):
        def equations(self):
            total = 0.0
            for i in range(self.order):
                total += (i + 1) * self.k
            total *= 2.0
            self.y = total
            self.der.s = 0.0

    assert [value_of(Sum, order=n) for n in (0, 1, 2, 3)] == [0.0, 6.0, 18.0, 36.0]


def test_loops_with_the_same_counter_are_independent():
    class Loops(Part):
        def equations(self):
            a = 0.0
            for i in range(3):
                a += i
            self.der.s = a - self.y
            b = 0.0
            for i in range(4):
                b += i
            self.y = b

    system = built(Loops)
    assert value_of(Loops) == 6.0
    assert system.rhs(0.0, system.start)[system.index("state", "part.s")] == -3.0


def test_options_fold_also_beside_other_conditions():
    class Folded(Part):
        def equations(self):
            if self.mode == "soft" and self.flange.position > 0.0:
                self.y = 1.0
            elif self.mode in ("hard", "none") or self.flange.position < 0.0:
                self.y = 2.0
            else:
                self.y = 3.0
            self.der.s = 0.0

    assert [value_of(Folded, mode=m) for m in ("soft", "hard", "none")] == [1.0, 2.0, 2.0]


def test_local_names_do_not_meet_declared_ones():
    """A local name may be that of a parameter, of a port's quantity or of another component's variable."""

    class Locals(Part):
        def equations(self):
            k = 2.0 * self.k
            flange__force = 1.0
            d_k = 3.0
            lambda_ = 4.0
            _ = 5.0
            t = 6.0
            self.y = k + 10.0 * self.k + flange__force + d_k + lambda_ + _ + t
            self.der.s = 0.0

    assert value_of(Locals) == 6.0 + 30.0 + 1.0 + 3.0 + 4.0 + 5.0 + 6.0


def test_super_and_local_names_of_base_and_subclass():
    class Base(Part):
        def equations(self):
            part = 2.0
            self.y = part * self.k
            self.der.s = part

    class Sub(Base):
        def equations(self):
            super().equations()
            part = 10.0
            self.flange.force = part * self.y

    system = built(Sub)
    rates = system.rhs(0.0, system.start)
    assert rates[system.index("state", "part.s")] == 2.0
    assert rates[system.index("state", "body.velocity")] == 60.0


def test_results_of_a_function_with_several_values():
    class Several(Part):
        def equations(self):
            larger, side = branches(self.k, 5.0)
            self.y = larger * side
            self.der.s = 0.0

    assert (value_of(Several), value_of(Several, k=6.0)) == (-5.0, 6.0)


def test_numba_function_can_be_called(tmp_path):
    cls = made(
        "self.y = law(2.0)\nself.der.s = 0.0",
        tmp_path,
        "from numba import njit\n\n@njit\ndef law(x):\n    return 3.0 * x\n",
    )
    assert value_of(cls) == 6.0


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("2 > 1", "True"),
        ("not True", "False"),
        ("1 < 2 < 3", "True"),
        ("1 < 3 < 2", "False"),
        ("'a' in ('a', 'b')", "True"),
        ("x > 0 and False", "False"),
        ("x > 0 or True", "True"),
        ("x > 0 and True", "x > 0"),
        ("not (x > 0 or False)", "not x > 0"),
        ("x > 0 or y > 0", "x > 0 or y > 0"),
    ],
)
def test_simplified_conditions(text, wanted):
    import ast

    assert ast.unparse(simplified(ast.parse(text, mode="eval").body)) == wanted


def test_variables_of_different_names_differ():
    """All dotted names of up to four words from a small alphabet, as components and declarations allow
    them.
    """
    words = ("a", "b", "d_a", "a_b")
    names = [".".join(c) for n in (1, 2, 3, 4) for c in itertools.product(words, repeat=n)]
    made = {variable(name): name for name in names}
    assert len(made) == len(names)
    assert all(readable(v) == name for v, name in made.items())


def test_whole_and_real_numbers_mix_alike_in_compiled_code():
    """Plain and compiled evaluation agree where whole numbers and branches mix."""
    code = """
        from test_equation_subset import Mixed, built
        from multibody import Model
        from multibody.library import Mass
        model = Model("m")
        model.add("body", Mass(m=1.0, position=0.5))
        part = model.add("part", Mixed())
        model.connect(part.flange, "body.flange")
        both = [model.build(compiled=c) for c in (True, False)]
        print(*(s.rhs(0.0, s.start).tolist() for s in both))
    """
    from pathlib import Path

    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parent,
    )
    assert done.returncode == 0, done.stderr
    first, second = done.stdout.strip().split("] [")
    assert first.strip("[]") == second.strip("[]")


class Mixed(Part):
    """Whole and real numbers in the branches of one variable, and flags used as conditions."""

    def equations(self):
        moving = abs(self.flange.velocity) > 0.1
        if moving and self.flange.position > 0:  # noqa: SIM108 - branches are what is tested
            side = 1
        else:
            side = -0.5
        count = 0
        for i in range(3):
            count = count + i
        self.y = side * count + math.pow(2, -1)
        self.der.s = 1 if not moving else self.y
        self.flange.force = self.curve(self.flange.position) - 3 % 2
