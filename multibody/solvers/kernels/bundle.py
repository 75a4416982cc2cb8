"""What a compiled driver gets of a problem: one vector of numbers and addresses."""

from __future__ import annotations

from typing import Any

import numpy as np

from multibody.compiler.kinds import address_of

__all__ = ["CUBIC", "FADING", "HOLD", "LINEAR", "Field"]

HOLD, LINEAR, CUBIC = 0, 1, 2
FADING = -2  # the channel of a direction that only begins: once it has died away, its rates are zero

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
# and the interval within which rates of inputs are looked up, with the time of the inputs that u holds.
WINDOW = 35
# Directions side by side: address of the tangent along several of them or 0, how many it carries, whether an input
# moves along any; room for states, inputs and results by lanes, and the parameters' tangents, one group of lanes
# after another.
WIDE, LANES, PUSHED, X_WIDE, U_WIDE, P_WIDE, OUT_WIDE = range(36, 43)
SIZE = 43

_TABLE = {
    "times": TIMES,
    "values": VALUES,
    "slopes": SLOPES,
    "kinds": KINDS,
    "delays": DELAYS,
    "held": HELD,
    "moving": MOVING,
    "breaks": BREAKS,
    "jumps": JUMPS,
    "break_start": BREAK_START,
    "break_delay": BREAK_DELAY,
}
_OWN = [RHS, TANGENT, N, N_P, P, U, RATE, U_DOT, WINDOW, CURSOR, SHAPE_CURSOR, BREAK_CURSOR]
_IN_LANES = [WIDE, LANES, PUSHED, X_WIDE, U_WIDE, P_WIDE, OUT_WIDE]
_DIRECTIONS = {"p_dot": P_DOT, "channel": CHANNEL, "weight": WEIGHT, "shape_t": SHAPE_T, "shape": SHAPE}


def _numbers_of(table: dict[str, np.ndarray]) -> np.ndarray:
    """Return the part of the vector that belongs to a table of inputs; kept with the table."""
    if "numbers" not in table:
        numbers = np.zeros(SIZE, dtype=np.int64)
        for name, index in _TABLE.items():
            numbers[index] = address_of(table[name])
        numbers[N_U], numbers[ROWS] = table["values"].shape[1], table["times"].size
        numbers[N_HELD], numbers[N_MOVING] = table["held"].size, table["moving"].size
        numbers[N_GROUPS] = table["break_delay"].size
        table["numbers"] = numbers
    return table["numbers"]


class Field:
    """Equations, parameters, inputs and directions of one problem as a vector for compiled drivers.

    It owns the workspace of one integration: two threads need two Fields.

    Parameters
    ----------
    rhs, tangent : int
        Addresses; 0 for no tangent.
    n : int
        Number of states.
    p : ndarray, shape (n_p,)
        Parameters.
    table : dict of ndarray
        The table of inputs: times (nt,), values and slopes (nt, n_u), kinds and delays (n_u,), held, moving,
        breaks and jumps (nb,), break_start (groups + 1,), break_delay (groups,).
    directions : dict of ndarray, optional
        p_dot (m, n_p), channel (m,), weight (m, n_u), shape_t (ns,), shape (ns, m).
    wide : (int, int), optional
        Address of the tangent along several directions at once, and how many it carries.

    Attributes
    ----------
    numbers : ndarray of int64
        The vector.  It points into the arrays that the Field holds.
    u : ndarray, shape (n_u,)
        Inputs of the last evaluation.
    """

    def __init__(
        self,
        rhs: int,
        tangent: int,
        n: int,
        p: np.ndarray,
        table: dict[str, np.ndarray],
        directions: dict[str, np.ndarray] | None = None,
        wide: tuple[int, int] | None = None,
    ) -> None:
        self.numbers = _numbers_of(table).copy()
        n_u, groups = table["values"].shape[1], table["break_delay"].size
        work = np.zeros(3 * n_u + 3)
        self.u = work[:n_u]
        self.u[:] = table["values"][0]
        work[3 * n_u :] = -np.inf, np.inf, np.nan
        cursors = np.zeros(n_u + groups + 1, dtype=np.int64)
        cursors[n_u + 1 :] = table["break_start"][:-1]
        self._owned: tuple[Any, ...] = (p, table, work, cursors, directions)
        floats, counts = address_of(work), address_of(cursors)
        self.numbers[_OWN] = (
            rhs,
            tangent,
            n,
            p.size,
            address_of(p),
            floats,
            floats + 8 * n_u,
            floats + 16 * n_u,
            floats + 24 * n_u,
            counts,
            counts + 8 * n_u,
            counts + 8 * (n_u + 1),
        )
        if directions is not None:
            for name, index in _DIRECTIONS.items():
                self.numbers[index] = address_of(directions[name])
            self.numbers[M], self.numbers[SHAPE_ROWS] = len(directions["channel"]), directions["shape_t"].size
            self.numbers[DELAYED] = int(np.any(directions["weight"] != 0.0))
            if wide is not None:
                self._put_in_lanes(*wide, n, directions)

    def _put_in_lanes(self, address: int, lanes: int, n: int, directions: dict[str, np.ndarray]) -> None:
        """Make room for the tangent along ``lanes`` directions at once."""
        p_dot, channel = directions["p_dot"], directions["channel"]
        m, n_p = p_dot.shape
        groups, n_u = -(-m // lanes), directions["weight"].shape[1]
        by_lane = np.zeros((groups * lanes, n_p))
        by_lane[:m] = p_dot
        by_lane = np.ascontiguousarray(by_lane.reshape(groups, lanes, n_p).transpose(0, 2, 1))
        room = np.zeros((2 * n + n_u) * lanes)
        self._owned += (by_lane, room)
        at = address_of(room)
        self.numbers[_IN_LANES] = (
            address,
            lanes,
            int(self.numbers[DELAYED] != 0 or np.any(channel >= 0)),
            at,
            at + 8 * n * lanes,
            address_of(by_lane),
            at + 8 * (n + n_u) * lanes,
        )
