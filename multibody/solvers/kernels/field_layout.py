"""What a compiled driver gets of a problem: one vector of numbers and addresses."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from multibody.compile.emitter.kinds import address_of

__all__ = ["FADING", "HOLD", "LINEAR", "Field"]

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
# and the interval within which rates of inputs are looked up, with the time of the inputs that u holds, and the
# samples per second where they are even, else zero;
WINDOW = 35
# the tangent of several directions at once, how many (0: none), parameter tangents in its order, room for its other
# arguments, and whether any direction acts on an input.
WIDE, LANES, P_WIDE, ROOM, PUSHED = range(36, 41)
# For the Jacobian: a derivative by the states along several directions at once, how many (0: none), the directions in
# its order, and room for its result.
COLUMNS, COLUMN_LANES, SEEDS, PASSED = range(41, 45)
# For what passes by: its speeds' address and number, its widths, and room for the speeds.
SPEEDS, N_SPEEDS, WIDTHS, PACES = range(45, 49)
# And whether every moving column is linear and without delay.
PLAIN = 49
SIZE = 50

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
_DIRECTIONS = {"p_dot": P_DOT, "channel": CHANNEL, "weight": WEIGHT, "shape_t": SHAPE_T, "shape": SHAPE}

_made: WeakKeyDictionary[Any, tuple[np.ndarray, np.ndarray, np.ndarray]] = WeakKeyDictionary()


def _of_table(table: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what belongs to a table of inputs, and is kept as long as it: its part of the vector, and the workspace.

    The workspace holds inputs, their rates, their tangent and the window; and the remembered intervals.
    """
    made = _made.get(table)
    if made is None:
        numbers = np.zeros(SIZE, dtype=np.int64)
        for name, index in _TABLE.items():
            numbers[index] = address_of(table[name])
        numbers[N_U], numbers[ROWS] = table["values"].shape[1], table["times"].size
        numbers[N_HELD], numbers[N_MOVING] = table["held"].size, table["moving"].size
        numbers[N_GROUPS] = table["break_delay"].size
        moving = table["moving"]
        numbers[PLAIN] = np.all(table["kinds"][moving] == LINEAR) and np.all(table["delays"][moving] < 0)
        n_u = table["values"].shape[1]
        work = np.zeros(3 * n_u + 4)
        work[:n_u] = table["values"][0]
        work[3 * n_u :] = -np.inf, np.inf, np.nan, _samples_per_second(table["times"])
        cursors = np.zeros(n_u + table["break_delay"].size + 1, dtype=np.int64)
        cursors[n_u + 1 :] = table["break_start"][:-1]
        made = _made[table] = numbers, work, cursors
    return made


def _samples_per_second(times: np.ndarray) -> float:
    """Return the pace of a grid whose times are nowhere off an even one by half of its spacing, else zero."""
    if times.size < 2:
        return 0.0
    pace = (times.size - 1) / (times[-1] - times[0])
    off = np.abs((times - times[0]) * pace - np.arange(times.size))
    return float(pace) if np.max(off) < 0.5 else 0.0


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
    wide : (int, int)
        Address of a tangent of several directions at once, and how many (see `multibody.compile.vector_mode`);
        0 for none.
    columns : int
        Address of a derivative by the states along several directions at once, for the Jacobian; 0 for none.
    seeds : ndarray, shape (groups, n, lanes), optional
        Its directions.
    speeds : int
        Address of the speeds at which something narrow passes by; 0 for none.
    widths : ndarray, shape (n_speeds,), optional
        Its widths.

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
        wide: tuple[int, int] = (0, 0),
        columns: int = 0,
        seeds: np.ndarray | None = None,
        speeds: int = 0,
        widths: np.ndarray | None = None,
    ) -> None:
        numbers, work, cursors = (part.copy() for part in _of_table(table))
        n_u = table["values"].shape[1]
        self.numbers, self.u = numbers, work[:n_u]
        self._owned: tuple[Any, ...] = (p, table, work, cursors, directions)
        floats, counts = address_of(work), address_of(cursors)
        numbers[: N + 1] = rhs, tangent, n
        numbers[N_P], numbers[P] = p.size, address_of(p)
        numbers[U : CURSOR + 1] = floats, floats + 8 * n_u, floats + 16 * n_u, counts
        numbers[WINDOW], numbers[SHAPE_CURSOR] = floats + 24 * n_u, counts + 8 * n_u
        numbers[BREAK_CURSOR] = counts + 8 * (n_u + 1)
        if columns and seeds is not None:
            passed = np.empty(seeds.shape[1:])
            self._owned += (seeds, passed)
            self.numbers[COLUMNS : PASSED + 1] = columns, seeds.shape[2], address_of(seeds), address_of(passed)
        if speeds and widths is not None and widths.size:
            paces = np.zeros(widths.size)
            self._owned += (widths, paces)
            self.numbers[SPEEDS : PACES + 1] = speeds, widths.size, address_of(widths), address_of(paces)
        if directions is not None:
            for name, index in _DIRECTIONS.items():
                self.numbers[index] = address_of(directions[name])
            self.numbers[M], self.numbers[SHAPE_ROWS] = len(directions["channel"]), directions["shape_t"].size
            self.numbers[DELAYED] = int(np.any(directions["weight"] != 0.0))
            self.numbers[PUSHED] = int(self.numbers[DELAYED] or np.any(directions["channel"] >= 0))
            if wide[0] != 0:
                self._widen(*wide, directions["p_dot"], n, n_u)

    def _widen(self, address: int, lanes: int, p_dot: np.ndarray, n: int, n_u: int) -> None:
        """Lay the directions side by side in groups; the last group is filled up with zeros."""
        groups = -(-len(p_dot) // lanes)
        full = np.zeros((groups * lanes, p_dot.shape[1]))
        full[: len(p_dot)] = p_dot
        grouped = np.ascontiguousarray(full.reshape(groups, lanes, -1).transpose(0, 2, 1))
        room = np.zeros((2 * n + n_u) * lanes)
        self._owned = (*self._owned, grouped, room)
        self.numbers[[WIDE, LANES, P_WIDE, ROOM]] = address, lanes, address_of(grouped), address_of(room)
