"""Functions of a model evaluated at every row of a trajectory; arrays are contiguous."""

from __future__ import annotations

import numpy as np

from multibody.compile.native import NativeFunction
from multibody.compile.vector_mode import MANY_LANES, along_directions
from multibody.solvers.kernels import along

__all__ = ["derivative_rows", "jacobian_in_lanes", "jacobian_rows", "output_rows"]


def output_rows(
    function: NativeFunction, rows: int, times: np.ndarray, states: np.ndarray, inputs: np.ndarray, every: np.ndarray
) -> np.ndarray:
    """Return the values of a function, as many as ``rows``, with each of several parameters, shape (k, nt, rows)."""
    shape = (times.size, rows)
    outputs, own, out = np.empty((len(every), *shape)), np.empty(every.shape[1]), np.empty(shape)
    work = along.rhs_along.bound(function.address, times, states, inputs, own, out)
    for k, values in enumerate(every):
        own[:] = values
        work()
        outputs[k] = out
    function.check()
    return outputs


def jacobian_rows(
    tangent: NativeFunction,
    rows: int,
    sizes: dict[str, int],
    wrt: str,
    chosen: np.ndarray,
    times: np.ndarray,
    states: np.ndarray,
    inputs: np.ndarray,
    p: np.ndarray,
) -> np.ndarray:
    """Return some columns of a Jacobian by its tangent, shape (nt, rows, columns).

    Parameters
    ----------
    sizes : dict
        Numbers of states, inputs and parameters by "x", "u" and "p".
    wrt : {"x", "u", "p"}
    chosen : ndarray of int
        The columns.
    """
    wide = along_directions(tangent, MANY_LANES)
    if wide is not None:
        return jacobian_in_lanes(wide, rows, sizes, wrt, chosen, times, states, inputs, p)
    m = chosen.size
    seeds = {key: np.zeros((m, size)) for key, size in sizes.items()}
    seeds[wrt][np.arange(m), chosen] = 1.0
    derivatives = np.empty((times.size, m, rows))
    along.tangents_along(tangent.address, times, states, inputs, p, *seeds.values(), derivatives)
    tangent.check()
    return derivatives.transpose(0, 2, 1)


def jacobian_in_lanes(
    wide: NativeFunction,
    rows: int,
    sizes: dict[str, int],
    wrt: str,
    chosen: np.ndarray,
    times: np.ndarray,
    states: np.ndarray,
    inputs: np.ndarray,
    p: np.ndarray,
) -> np.ndarray:
    """Return the same by a tangent of several directions at once."""
    m = chosen.size
    room, out = np.empty((rows, wide.lanes)), np.empty((times.size, rows, m))
    group, lane = np.divmod(np.arange(m), wide.lanes)
    lanes = {key: np.zeros((-(-m // wide.lanes), size, wide.lanes)) for key, size in sizes.items()}
    lanes[wrt][group, chosen, lane] = 1.0
    along.lanes_along(wide.address, times, states, inputs, p, *lanes.values(), room, out)
    return out


def derivative_rows(
    tangent: NativeFunction,
    rows: int,
    times: np.ndarray,
    states: np.ndarray,
    inputs: np.ndarray,
    rates: np.ndarray,
    p: np.ndarray,
    p_dot: np.ndarray,
    shape: np.ndarray,
    channel: np.ndarray,
    delays: np.ndarray,
) -> np.ndarray:
    """Return derivatives along directions whose states stand in the rows, shape (nt, rows, m).

    Arguments as of `multibody.system.along_trajectory.observe_along`.
    """
    m, n_u = len(p_dot), inputs.shape[1]
    derivatives = np.empty((times.size, m, rows))
    wide = along_directions(tangent, MANY_LANES)
    at = times, states, inputs, rates, p
    if wide is None:
        along.observe_along(tangent.address, *at, p_dot, shape, channel, delays, np.empty(n_u), derivatives)
        tangent.check()
        return derivatives.transpose(0, 2, 1)
    room = np.zeros((states.shape[1] // (m + 1) + n_u + rows) * MANY_LANES)
    for first in range(0, m, MANY_LANES):
        some_dot = p_dot[first : first + MANY_LANES]
        lanes = np.zeros((p.size, MANY_LANES))
        lanes[:, : len(some_dot)] = some_dot.T
        some = np.empty((times.size, len(some_dot), rows))
        along.observe_lanes_along(wide.address, first, *at, lanes, shape, channel, delays, room, some)
        derivatives[:, first : first + len(some_dot)] = some
    return derivatives.transpose(0, 2, 1)
