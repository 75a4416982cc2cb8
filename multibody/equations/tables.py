"""Curves given by points, evaluated inside equations: piecewise linear and shape-preserving cubic.

The points live in the parameter vector ``p`` from index ``start``: first the ``size`` arguments, then the ``size``
values and, for the cubic, the ``size`` slopes.  Outside its points a curve is constant.  The functions are kernels:
they are written in the subset for equations, and each is followed by its exact directional derivative.
"""

from __future__ import annotations

import numpy as np

__all__ = [
    "SLOPES",
    "TANGENTS",
    "cubic",
    "cubic_rate",
    "cubic_rate_slope",
    "cubic_rate_tangent",
    "interval",
    "linear",
    "linear_rate",
    "linear_rate_slope",
    "linear_rate_tangent",
    "linear_tangent",
    "packed",
]


def interval(p, start, size, x):
    """Return k such that x lies between points k and k + 1, the first and last interval taking what is outside."""
    low = 0
    high = size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if p[start + middle] <= x:
            low = middle
        else:
            high = middle
    return low


def linear(p, start, size, x):
    """Return the piecewise linear curve at x."""
    if x <= p[start]:
        return p[start + size]
    if x >= p[start + size - 1]:
        return p[start + 2 * size - 1]
    k = start + interval(p, start, size, x)
    s = (x - p[k]) / (p[k + 1] - p[k])
    return p[k + size] + s * (p[k + size + 1] - p[k + size])


def linear_tangent(p, p_dot, start, size, x, x_dot):
    """Return the piecewise linear curve and its directional derivative; argument and points may change."""
    if x <= p[start]:
        return p[start + size], p_dot[start + size]
    if x >= p[start + size - 1]:
        return p[start + 2 * size - 1], p_dot[start + 2 * size - 1]
    k = start + interval(p, start, size, x)
    width = p[k + 1] - p[k]
    s = (x - p[k]) / width
    s_dot = (x_dot - (1.0 - s) * p_dot[k] - s * p_dot[k + 1]) / width
    rise = p[k + size + 1] - p[k + size]
    value = p[k + size] + s * rise
    return value, s_dot * rise + (1.0 - s) * p_dot[k + size] + s * p_dot[k + size + 1]


def cubic(p, start, size, x):
    """Return the cubic Hermite curve at x."""
    if x <= p[start]:
        return p[start + size]
    if x >= p[start + size - 1]:
        return p[start + 2 * size - 1]
    k = start + interval(p, start, size, x)
    width = p[k + 1] - p[k]
    s = (x - p[k]) / width
    y0 = p[k + size]
    rise = p[k + size + 1] - y0
    d0 = p[k + 2 * size] * width
    d1 = p[k + 2 * size + 1] * width
    return y0 + s * (d0 + s * (3.0 * rise - 2.0 * d0 - d1 + s * (d0 + d1 - 2.0 * rise)))


def cubic_tangent(p, p_dot, start, size, x, x_dot):
    """Return the cubic Hermite curve and its directional derivative; argument, points and slopes may change."""
    if x <= p[start]:
        return p[start + size], p_dot[start + size]
    if x >= p[start + size - 1]:
        return p[start + 2 * size - 1], p_dot[start + 2 * size - 1]
    k = start + interval(p, start, size, x)
    width = p[k + 1] - p[k]
    width_dot = p_dot[k + 1] - p_dot[k]
    s = (x - p[k]) / width
    s_dot = (x_dot - p_dot[k] - s * width_dot) / width
    y0 = p[k + size]
    rise = p[k + size + 1] - y0
    d0 = p[k + 2 * size] * width
    d1 = p[k + 2 * size + 1] * width
    c2 = 3.0 * rise - 2.0 * d0 - d1
    c3 = d0 + d1 - 2.0 * rise
    value = y0 + s * (d0 + s * (c2 + s * c3))
    slope = d0 + s * (2.0 * c2 + 3.0 * s * c3)
    y0_dot = p_dot[k + size]
    rise_dot = p_dot[k + size + 1] - y0_dot
    e0 = p_dot[k + 2 * size] * width + p[k + 2 * size] * width_dot
    e1 = p_dot[k + 2 * size + 1] * width + p[k + 2 * size + 1] * width_dot
    of_points = y0_dot + s * (e0 + s * (3.0 * rise_dot - 2.0 * e0 - e1 + s * (e0 + e1 - 2.0 * rise_dot)))
    return value, s_dot * slope + of_points


def linear_slope(p, start, size, x):
    """Return the piecewise linear curve and its slope at x."""
    if x <= p[start]:
        return p[start + size], 0.0
    if x >= p[start + size - 1]:
        return p[start + 2 * size - 1], 0.0
    k = start + interval(p, start, size, x)
    slope = (p[k + size + 1] - p[k + size]) / (p[k + 1] - p[k])
    return p[k + size] + slope * (x - p[k]), slope


def cubic_slope(p, start, size, x):
    """Return the cubic Hermite curve and its slope at x."""
    if x <= p[start]:
        return p[start + size], 0.0
    if x >= p[start + size - 1]:
        return p[start + 2 * size - 1], 0.0
    k = start + interval(p, start, size, x)
    width = p[k + 1] - p[k]
    s = (x - p[k]) / width
    rise = p[k + size + 1] - p[k + size]
    d0 = p[k + 2 * size] * width
    d1 = p[k + 2 * size + 1] * width
    c2 = 3.0 * rise - 2.0 * d0 - d1
    c3 = d0 + d1 - 2.0 * rise
    return p[k + size] + s * (d0 + s * (c2 + s * c3)), (d0 + s * (2.0 * c2 + 3.0 * s * c3)) / width


def linear_rate(p, start, size, x):
    """Return the slope of the piecewise linear curve at x."""
    if x <= p[start] or x >= p[start + size - 1]:
        return 0.0
    k = start + interval(p, start, size, x)
    return (p[k + size + 1] - p[k + size]) / (p[k + 1] - p[k])


def linear_rate_tangent(p, p_dot, start, size, x, x_dot):
    """Return the slope of the piecewise linear curve and its directional derivative."""
    if x <= p[start] or x >= p[start + size - 1]:
        return 0.0, 0.0
    k = start + interval(p, start, size, x)
    width = p[k + 1] - p[k]
    slope = (p[k + size + 1] - p[k + size]) / width
    return slope, (p_dot[k + size + 1] - p_dot[k + size] - slope * (p_dot[k + 1] - p_dot[k])) / width


def linear_rate_slope(p, start, size, x):
    """Return the slope of the piecewise linear curve and the slope of that."""
    if x <= p[start] or x >= p[start + size - 1]:
        return 0.0, 0.0
    k = start + interval(p, start, size, x)
    return (p[k + size + 1] - p[k + size]) / (p[k + 1] - p[k]), 0.0


def cubic_rate(p, start, size, x):
    """Return the slope of the cubic Hermite curve at x."""
    if x <= p[start] or x >= p[start + size - 1]:
        return 0.0
    k = start + interval(p, start, size, x)
    width = p[k + 1] - p[k]
    s = (x - p[k]) / width
    secant = (p[k + size + 1] - p[k + size]) / width
    m0 = p[k + 2 * size]
    m1 = p[k + 2 * size + 1]
    return m0 + s * (2.0 * (3.0 * secant - 2.0 * m0 - m1) + 3.0 * s * (m0 + m1 - 2.0 * secant))


def cubic_rate_tangent(p, p_dot, start, size, x, x_dot):
    """Return the slope of the cubic Hermite curve and its directional derivative; points and slopes may change."""
    if x <= p[start] or x >= p[start + size - 1]:
        return 0.0, 0.0
    k = start + interval(p, start, size, x)
    width = p[k + 1] - p[k]
    width_dot = p_dot[k + 1] - p_dot[k]
    s = (x - p[k]) / width
    s_dot = (x_dot - p_dot[k] - s * width_dot) / width
    secant = (p[k + size + 1] - p[k + size]) / width
    secant_dot = (p_dot[k + size + 1] - p_dot[k + size] - secant * width_dot) / width
    m0 = p[k + 2 * size]
    m1 = p[k + 2 * size + 1]
    m0_dot = p_dot[k + 2 * size]
    m1_dot = p_dot[k + 2 * size + 1]
    c2 = 3.0 * secant - 2.0 * m0 - m1
    c3 = m0 + m1 - 2.0 * secant
    c2_dot = 3.0 * secant_dot - 2.0 * m0_dot - m1_dot
    c3_dot = m0_dot + m1_dot - 2.0 * secant_dot
    value = m0 + s * (2.0 * c2 + 3.0 * s * c3)
    return value, s_dot * (2.0 * c2 + 6.0 * s * c3) + m0_dot + s * (2.0 * c2_dot + 3.0 * s * c3_dot)


def cubic_rate_slope(p, start, size, x):
    """Return the slope of the cubic Hermite curve and the slope of that."""
    if x <= p[start] or x >= p[start + size - 1]:
        return 0.0, 0.0
    k = start + interval(p, start, size, x)
    width = p[k + 1] - p[k]
    s = (x - p[k]) / width
    secant = (p[k + size + 1] - p[k + size]) / width
    m0 = p[k + 2 * size]
    m1 = p[k + 2 * size + 1]
    c2 = 3.0 * secant - 2.0 * m0 - m1
    c3 = m0 + m1 - 2.0 * secant
    return m0 + s * (2.0 * c2 + 3.0 * s * c3), (2.0 * c2 + 6.0 * s * c3) / width


#: by curve: value and directional derivative, the points may change as well
TANGENTS = {
    linear: linear_tangent,
    cubic: cubic_tangent,
    linear_rate: linear_rate_tangent,
    cubic_rate: cubic_rate_tangent,
}
#: by curve: value and slope with the points held
SLOPES = {
    linear: linear_slope,
    cubic: cubic_slope,
    linear_rate: linear_rate_slope,
    cubic_rate: cubic_rate_slope,
}


def pchip_slopes(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the slopes of the shape-preserving cubic through points (Fritsch and Butland 1984).

    Examples
    --------
    >>> pchip_slopes(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 0.0]))[1]
    np.float64(0.0)
    """
    width, secant = np.diff(x), np.diff(y) / np.diff(x)
    if x.size == 2:
        return np.repeat(secant, 2)
    w1, w2 = 2 * width[1:] + width[:-1], width[1:] + 2 * width[:-1]
    same_sign = secant[:-1] * secant[1:] > 0
    safe = np.where(secant == 0, 1.0, secant)
    inverse = np.where(same_sign, w1 / safe[:-1] + w2 / safe[1:], 1.0)
    harmonic = (w1 + w2) / inverse
    slopes = np.zeros_like(y)
    slopes[1:-1] = np.where(same_sign, harmonic, 0.0)
    slopes[0] = _end_slope(width[0], width[1], secant[0], secant[1])
    slopes[-1] = _end_slope(width[-1], width[-2], secant[-1], secant[-2])
    return slopes


def _end_slope(h0: float, h1: float, s0: float, s1: float) -> float:
    slope = ((2 * h0 + h1) * s0 - h0 * s1) / (h0 + h1)
    if np.sign(slope) != np.sign(s0):
        return 0.0
    if np.sign(s0) != np.sign(s1) and abs(slope) > 3 * abs(s0):
        return 3.0 * s0
    return float(slope)


def packed(x: np.ndarray, y: np.ndarray, interpolation: str) -> np.ndarray:
    """Return a curve's points as a part of the parameter vector."""
    return np.concatenate([x, y, pchip_slopes(x, y)] if interpolation == "cubic" else [x, y])
