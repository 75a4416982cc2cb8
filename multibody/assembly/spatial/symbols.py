"""Vector algebra on texts: products and sums in which zeros and ones are left out, bound to names once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from multibody.assembly.equation_set import Assembly

__all__ = [
    "ONE",
    "UNIT",
    "ZERO",
    "ZERO_VECTOR",
    "Matrix",
    "Vector",
    "Writer",
    "cross",
    "dot",
    "matmul",
    "neg",
    "plus",
    "times",
    "transpose",
    "turn",
]

Vector = tuple[str, str, str]
Matrix = tuple[Vector, Vector, Vector]

ZERO, ONE = "0.0", "1.0"
ZERO_VECTOR: Vector = (ZERO, ZERO, ZERO)
UNIT: Matrix = ((ONE, ZERO, ZERO), (ZERO, ONE, ZERO), (ZERO, ZERO, ONE))


def _is_name(text: str) -> bool:
    return text.isidentifier()


def _is_number(text: str) -> bool:
    return text[:1].isdigit()


def is_simple(text: str) -> bool:
    """Tell whether a text is a name or a number, perhaps with a minus: which needs no variable of its own."""
    bare = text.removeprefix("-")
    return _is_name(bare) or _is_number(bare)


def _is_sum(text: str) -> bool:
    return " + " in text or " - " in text


def neg(a: str) -> str:
    """Return −a.

    Examples
    --------
    >>> neg("-x"), neg("0.0"), neg("x + y")
    ('x', '0.0', '-(x + y)')
    """
    if a == ZERO:
        return ZERO
    if _is_sum(a):
        return f"-({a})"
    return a[1:] if a.startswith("-") else f"-{a}"


def times(*factors: str) -> str:
    """Return a product; zero takes it away, ones are left out, signs go to the front.

    Examples
    --------
    >>> times("a", "-b"), times("a", "0.0"), times("-1.0", "a"), times("a", "b + c")
    ('-a * b', '0.0', '-a', 'a * (b + c)')
    """
    negative, remaining = False, []
    for factor in factors:
        if factor == ZERO:
            return ZERO
        if _is_sum(factor):
            remaining.append(f"({factor})")
            continue
        if factor.startswith("-"):
            negative, factor = not negative, factor[1:]
        if factor != ONE:
            remaining.append(factor)
    text = " * ".join(remaining) or ONE
    return f"-{text}" if negative else text


def plus(*terms: str) -> str:
    """Return a sum without its zeros.

    Examples
    --------
    >>> plus("a", "-b * c", "0.0"), plus("0.0", "0.0")
    ('a - b * c', '0.0')
    """
    remaining = [t for t in terms if t != ZERO]
    if not remaining:
        return ZERO
    text = remaining[0]
    for term in remaining[1:]:
        if term.startswith("-") and not _is_sum(term):
            text += f" - {term[1:]}"
        else:
            text += f" + ({term})" if term.startswith("-") else f" + {term}"
    return text


def dot(a: Vector, b: Vector) -> str:
    """Return a·b."""
    return plus(*(times(x, y) for x, y in zip(a, b, strict=True)))


def cross(a: Vector, b: Vector) -> Vector:
    """Return a × b."""
    return (
        plus(times(a[1], b[2]), neg(times(a[2], b[1]))),
        plus(times(a[2], b[0]), neg(times(a[0], b[2]))),
        plus(times(a[0], b[1]), neg(times(a[1], b[0]))),
    )


def transpose(m: Matrix) -> Matrix:
    """Return the transpose; its rows are the columns of ``m``."""
    return tuple(zip(*m, strict=True))  # type: ignore[return-value]


def turn(m: Matrix, v: Vector) -> Vector:
    """Return m v."""
    return (dot(m[0], v), dot(m[1], v), dot(m[2], v))


def matmul(a: Matrix, b: Matrix) -> Matrix:
    """Return a b."""
    columns = transpose(b)
    return tuple(turn(columns, row) for row in a)  # type: ignore[return-value]


class Writer:
    """Binds texts to variables of an assembly, under the name of one component.

    Parameters
    ----------
    work : Assembly
    base : str
        Start of every variable name.
    origin : str
        Component name for messages and comments.
    """

    def __init__(self, work: Assembly, base: str, origin: str):
        self.work = work
        self.base = base
        self.origin = origin
        self._turned: dict[str, tuple[str, str]] = {}
        self._bound: dict[str, str] = {}

    def let(self, name: str, text: str) -> str:
        """Return a name for a text; a name or a number stays what it is."""
        if is_simple(text):
            return text
        return self.set(name, text)

    def set(self, name: str, text: str) -> str:
        """Give a text this name, whatever it is; the same again is written once."""
        var = f"{self.base}__{name}"
        if name not in self._bound:
            self._bound[name] = text
            self.work.add(f"{var} = {text}", self.origin)
        elif self._bound[name] != text:
            raise ValueError(f"{self.base}: '{name}' stands for '{self._bound[name]}' already, not '{text}'")
        return var

    def vector(self, name: str, texts: Sequence[str]) -> Vector:
        """Return names for the three components of a vector."""
        return tuple(self.let(f"{name}{k + 1}", t) for k, t in enumerate(texts))  # type: ignore[return-value]

    def matrix(self, name: str, rows: Iterable[Sequence[str]]) -> Matrix:
        """Return names for the entries of a 3 × 3 matrix."""
        return tuple(self.vector(f"{name}{k + 1}", row) for k, row in enumerate(rows))  # type: ignore[return-value]

    def sum(self, name: str, *vectors: Vector) -> Vector:
        """Return names for a sum of vectors."""
        return self.vector(name, [plus(*parts) for parts in zip(*vectors, strict=True)])

    def cosine_sine(self, name: str, angle: str) -> tuple[str, str]:
        """Return cosine and sine of an angle, computed once for each name."""
        if angle == ZERO:
            return ONE, ZERO
        if name not in self._turned:
            self._turned[name] = (
                self.let(f"cos_{name}", f"math.cos({angle})"),
                self.let(f"sin_{name}", f"math.sin({angle})"),
            )
        return self._turned[name]

    def rotation(self, name: str, angles: Vector) -> Matrix:
        """Return R = Rz(yaw) Ry(pitch) Rx(roll) for ``angles = (roll, pitch, yaw)``."""
        (cx, sx), (cy, sy), (cz, sz) = (
            self.cosine_sine(f"{name}_{axis}", angle) for axis, angle in zip("xyz", angles, strict=True)
        )
        rows: Matrix = (
            (
                times(cz, cy),
                plus(times(cz, sy, sx), neg(times(sz, cx))),
                plus(times(cz, sy, cx), times(sz, sx)),
            ),
            (
                times(sz, cy),
                plus(times(sz, sy, sx), times(cz, cx)),
                plus(times(sz, sy, cx), neg(times(cz, sx))),
            ),
            (neg(sy), times(cy, sx), times(cy, cx)),
        )
        return self.matrix(name, rows)
