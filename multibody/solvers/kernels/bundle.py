"""What a compiled driver gets of a problem."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

__all__ = ["CUBIC", "HOLD", "LINEAR", "Field"]

HOLD, LINEAR, CUBIC = 0, 1, 2


class Field(NamedTuple):
    """Equations, parameters, table of inputs and directions of one problem, with the workspace to evaluate
    them.

    Every array is contiguous and writable, because any other kind would make numba compile a second version.
    The workspace makes a Field the property of one integration: two threads need two.
    """

    rhs: int  # address of rhs
    tangent: int  # address of rhs_tangent, 0 if there is none
    n: int  # number of states
    m: int  # number of directions
    p: np.ndarray  # (n_p,) parameters
    times: np.ndarray  # (nt,) table of inputs
    values: np.ndarray  # (nt, n_u)
    slopes: np.ndarray  # (nt, n_u), used by cubic columns
    kinds: np.ndarray  # (n_u,) HOLD, LINEAR or CUBIC
    delays: np.ndarray  # (n_u,) index into p of the column's delay, or -1
    held: np.ndarray  # columns that change by jumps
    moving: np.ndarray  # columns that change continuously
    u: np.ndarray  # (n_u,) inputs; workspace
    rate: np.ndarray  # (n_u,) time derivatives of the delayed inputs; workspace
    u_dot: np.ndarray  # (n_u,) tangent of the inputs; workspace
    cursor: np.ndarray  # (n_u,) remembered interval of each column; workspace
    p_dot: np.ndarray  # (m, n_p) parameter tangents
    channel: np.ndarray  # (m,) input channel of the direction, or -1
    weight: np.ndarray  # (m, n_u) minus the tangent of the column's delay
    shape_t: np.ndarray  # (ns,) time grid of the input tangents
    shape: np.ndarray  # (ns, m) input tangents over time
    shape_cursor: np.ndarray  # (1,) workspace
    delayed: int  # 1 if any direction touches a delay
