"""What a compiled driver gets of a problem: one vector of numbers and addresses."""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["CUBIC", "HOLD", "LINEAR", "Field"]

HOLD, LINEAR, CUBIC = 0, 1, 2

# Indices into the vector.  First numbers: addresses of rhs and rhs_tangent, states, directions, inputs,
# parameters, rows of the table, columns that jump, columns that move, rows of the direction table, whether a
# direction touches a delay, groups of break times (those of one delay).
RHS, TANGENT, N, M, N_U, N_P, ROWS, N_HELD, N_MOVING, SHAPE_ROWS, DELAYED, N_GROUPS = range(12)
# Then addresses: parameters; table of inputs with its slopes; interpolation and delay of each column; columns
# that jump and that move; inputs, their rates, their tangent; remembered interval of each column;
P, TIMES, VALUES, SLOPES, KINDS, DELAYS, HELD, MOVING, U, RATE, U_DOT, CURSOR = range(12, 24)
# parameter tangents, input channels, weight of the rates; time grid and values of the input tangents, with
# the remembered interval;
P_DOT, CHANNEL, WEIGHT, SHAPE_T, SHAPE, SHAPE_CURSOR = range(24, 30)
# times at which a step must end, whether a held input jumps there; begin, delay, remembered time of each
# group;
BREAKS, JUMPS, BREAK_START, BREAK_DELAY, BREAK_CURSOR = range(30, 35)
# and the interval within which rates of inputs are looked up.
WINDOW = 35
SIZE = 36

_COUNTS = (
    KINDS,
    DELAYS,
    HELD,
    MOVING,
    CURSOR,
    CHANNEL,
    SHAPE_CURSOR,
    JUMPS,
    BREAK_START,
    BREAK_DELAY,
    BREAK_CURSOR,
)
_VECTORS = {
    "p": P,
    "times": TIMES,
    "values": VALUES,
    "slopes": SLOPES,
    "kinds": KINDS,
    "delays": DELAYS,
    "held": HELD,
    "moving": MOVING,
    "u": U,
    "rate": RATE,
    "u_dot": U_DOT,
    "cursor": CURSOR,
    "p_dot": P_DOT,
    "channel": CHANNEL,
    "weight": WEIGHT,
    "shape_t": SHAPE_T,
    "shape": SHAPE,
    "shape_cursor": SHAPE_CURSOR,
    "breaks": BREAKS,
    "jumps": JUMPS,
    "break_start": BREAK_START,
    "break_delay": BREAK_DELAY,
    "break_cursor": BREAK_CURSOR,
    "window": WINDOW,
}


class Field:
    """Equations, parameters, inputs and directions of one problem as a vector for compiled drivers.

    It owns the workspace of one integration: two threads need two Fields.

    Parameters
    ----------
    rhs, tangent : int
        Addresses; 0 for no tangent.
    n : int
        Number of states.
    vectors : ndarray
        By the names in lower case of the indices above: p (n_p,), times (nt,), values and slopes (nt, n_u),
        kinds and delays (n_u,), held, moving, p_dot (m, n_p), channel (m,), weight (m, n_u), shape_t (ns,),
        shape (ns, m), breaks and jumps (nb,), break_start (groups + 1,), break_delay (groups,).

    Attributes
    ----------
    numbers : ndarray of int64
        The vector.  It points into the arrays that the Field holds.
    u : ndarray, shape (n_u,)
        Inputs of the last evaluation.
    """

    def __init__(self, rhs: int, tangent: int, n: int, **vectors: np.ndarray) -> None:
        n_u, m = vectors["values"].shape[1], len(vectors["channel"])
        self.u = vectors["values"][0].copy()
        vectors.update(
            u=self.u, rate=np.zeros(n_u), u_dot=np.zeros(n_u), cursor=np.zeros(n_u, dtype=np.int64)
        )
        vectors["shape_cursor"] = np.zeros(1, dtype=np.int64)
        vectors["window"] = np.array([-np.inf, np.inf])
        vectors["break_cursor"] = vectors["break_start"][:-1].copy()
        self.numbers = np.zeros(SIZE, dtype=np.int64)
        self._owned: list[Any] = []
        for name, index in _VECTORS.items():
            kind = np.int64 if index in _COUNTS else np.float64
            array = np.ascontiguousarray(vectors[name], dtype=kind)
            self._owned.append(array)
            self.numbers[index] = array.ctypes.data
        self.numbers[: N_GROUPS + 1] = (
            rhs,
            tangent,
            n,
            m,
            n_u,
            vectors["p"].size,
            vectors["times"].size,
            vectors["held"].size,
            vectors["moving"].size,
            vectors["shape_t"].size,
            int(np.any(vectors["weight"] != 0.0)),
            vectors["break_delay"].size,
        )
