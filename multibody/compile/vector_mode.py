"""Derivatives along several directions in one pass: what does not depend on the direction is computed once.

A generated tangent ``f(t, x, u, p, x_dot, u_dot, p_dot, out)`` carries one direction.  Compiled for lanes, the same
text carries several: whatever a direction touches is then a vector of as many numbers, everything else stays a plain
number.  The emitter compiles it in a tenth of the time that numba takes for one direction (`docs/howto/speed.md`).
A single direction therefore goes in lanes as well where a whole trajectory is differentiated.
"""

from __future__ import annotations

from functools import lru_cache

from multibody.compile.emitter.kinds import Outside
from multibody.compile.native import TANGENT_ARRAYS, NativeFunction, compile_text, compiling
from multibody.compile.settings import jit_enabled

__all__ = ["FEW_LANES", "MANY_LANES", "along_directions", "along_states"]

FEW_LANES, MANY_LANES = 4, 8  # directions at once: one vector register or two of the common kind


def along_directions(tangent: NativeFunction, count: int) -> NativeFunction | None:
    """Return a tangent that carries several directions at once, or None where nothing is compiled.

    Parameters
    ----------
    tangent : NativeFunction
        Of a system: ``rhs_tangent`` or ``outputs_tangent``.
    count : int
        Number of directions; a multiple of four makes whole vector instructions.

    Returns
    -------
    NativeFunction or None
        ``f(t, x, u, p, x_dot, u_dot, p_dot, out)`` with directions ``x_dot`` (n, count), ``u_dot`` (n_u, count),
        ``p_dot`` (n_p, count), and ``out`` (rows, count).  None also where the text is outside the compiler's subset.
    """
    text, stem = tangent.origin
    return _made(text, stem, tangent.name, count) if tangent.compiled and text else None


def along_states(text: str, count: int) -> NativeFunction | None:
    """Return ``rhs_columns`` of a system's texts along several directions at once, as `along_directions` does."""
    return _made(text, "rhs_columns", "rhs_columns", count) if jit_enabled() else None


@lru_cache(maxsize=256)
def _made(text: str, stem: str, name: str, count: int) -> NativeFunction | None:
    try:
        with compiling:
            return compile_text(text, stem, name, TANGENT_ARRAYS, lanes=count)
    except Outside:
        return None
