"""Rates, readings and their derivatives for a machine with latent states behind its inputs and parameters.

``c`` is the vector of `layout`; ``z`` holds the machine's states and then the latent ones; ``u`` is a row of
inputs as recorded.
"""

from __future__ import annotations

import math

from estimation.filters.kernels.layout import (
    ALL,
    CHANNEL_INDEX,
    CHANNEL_KIND,
    DRIFT,
    EXACT,
    GENERIC,
    LARGEST,
    LD,
    N_READ,
    N_SPEEDS,
    N_U,
    OUT,
    OUT_T,
    OUT_W,
    P_0,
    P_DOT,
    P_WIDE,
    PACES,
    READ_INDEX,
    READ_KIND,
    READ_STATE,
    READ_WEIGHT,
    RHS,
    RHS_T,
    RHS_W,
    SPEEDS,
    STEPS,
    U_DOT,
    U_WIDE,
    WIDTHS,
    X_DOT,
    X_WIDE,
    A,
    B,
    M,
    N,
    P,
    U,
    Y,
)
from multibody.compile.calls import call_rhs, call_tangent, floats, inner, ints, shift
from multibody.solvers.kernels.stepping import half_passed

MOST_SUBSTEPS = 1000  # of an interval between two samples; a state that runs away asks for any number


@inner
def apply(c, z, u):
    """Add the latent states to inputs and parameters."""
    own_u, own_p, p = floats(c[U]), floats(c[P]), floats(c[P_0])
    for i in range(c[N_U]):
        own_u[i] = u[i]
    if c[N_READ] > 0:
        states, kinds = ints(c[READ_STATE]), ints(c[READ_KIND])
        indices, weights = ints(c[READ_INDEX]), floats(c[READ_WEIGHT])
        for r in range(c[N_READ]):
            if kinds[r] == 1:
                own_p[indices[r]] = p[indices[r]]
        for r in range(c[N_READ]):
            if kinds[r] == 0:
                own_u[indices[r]] += weights[r] * z[states[r]]
            else:
                own_p[indices[r]] += weights[r] * z[states[r]]


@inner
def drift(c, z, dz):
    """Write the rates of the latent states into dz."""
    n, latent, a = c[N], c[ALL] - c[N], floats(c[DRIFT])
    for i in range(latent):
        rate = 0.0
        for j in range(latent):
            rate += a[i * latent + j] * z[n + j]
        dz[n + i] = rate


@inner
def rates(c, t, z, u, dz):
    """Write the rates of all states into dz."""
    apply(c, z, u)
    call_rhs(c[RHS], t, z, floats(c[U]), floats(c[P]), dz)
    drift(c, z, dz)


@inner
def seed(c, j, value):
    """Set the direction of latent state n + j."""
    states, kinds = ints(c[READ_STATE]), ints(c[READ_KIND])
    indices, weights = ints(c[READ_INDEX]), floats(c[READ_WEIGHT])
    u_dot, p_dot = floats(c[U_DOT]), floats(c[P_DOT])
    for r in range(c[N_READ]):
        if states[r] == c[N] + j:
            if kinds[r] == 0:
                u_dot[indices[r]] = value * weights[r]
            else:
                p_dot[indices[r]] = value * weights[r]


@inner
def fill_drift(c, jac):
    """Write the latent rows of the Jacobian of the rates."""
    n, latent, ld, a = c[N], c[ALL] - c[N], c[LD], floats(c[DRIFT])
    for i in range(latent):
        for j in range(ld):
            jac[(n + i) * ld + j] = 0.0
        for j in range(latent):
            jac[(n + i) * ld + n + j] = a[i * latent + j]


@inner
def tangent_columns(c, which, rows, t, z, u, out):
    """Write the exact derivative of rates or outputs by every state, one column for each, into out."""
    apply(c, z, u)
    x_dot, u_dot, p_dot, column = floats(c[X_DOT]), floats(c[U_DOT]), floats(c[P_DOT]), floats(c[A])
    own_u, own_p = floats(c[U]), floats(c[P])
    n, ld = c[N], c[LD]
    for j in range(c[ALL]):
        if j < n:
            x_dot[j] = 1.0
        else:
            seed(c, j - n, 1.0)
        call_tangent(c[which], t, z, own_u, own_p, x_dot, u_dot, p_dot, column)
        if j < n:
            x_dot[j] = 0.0
        else:
            seed(c, j - n, 0.0)
        for i in range(rows):
            out[i * ld + j] = column[i]


@inner
def tangent_at_once(c, which, t, z, u, out):
    """The same in one pass over all directions; rows of out are padded with zeros."""
    apply(c, z, u)
    call_tangent(
        c[which], t, z, floats(c[U]), floats(c[P]), floats(c[X_WIDE]), floats(c[U_WIDE]), floats(c[P_WIDE]), out
    )


@inner
def difference_columns(c, which, rows, t, z, u, out):
    """The same by central differences; z is restored."""
    high, low, steps = floats(c[A]), floats(c[B]), floats(c[STEPS])
    own_u, own_p, ld = floats(c[U]), floats(c[P]), c[LD]
    for j in range(c[ALL]):
        middle = z[j]
        above, below = middle + steps[j], middle - steps[j]
        z[j] = above
        apply(c, z, u)
        call_rhs(c[which], t, z, own_u, own_p, high)
        z[j] = below
        apply(c, z, u)
        call_rhs(c[which], t, z, own_u, own_p, low)
        z[j] = middle
        factor = 1.0 / (above - below)
        for i in range(rows):
            out[i * ld + j] = factor * (high[i] - low[i])


@inner
def jacobian(c, t, z, u, jac):
    """Write ∂ż/∂z into jac."""
    if c[RHS_W] != 0:
        tangent_at_once(c, RHS_W, t, z, u, jac)
    elif c[EXACT] == 1:
        tangent_columns(c, RHS_T, c[N], t, z, u, jac)
    else:
        difference_columns(c, RHS, c[N], t, z, u, jac)
    fill_drift(c, jac)


@inner
def read(c, t, z, u, dz, y):
    """Write the measured channels into y, from the rates dz where they are rates."""
    kinds, indices, outputs = ints(c[CHANNEL_KIND]), ints(c[CHANNEL_INDEX]), floats(c[Y])
    if c[GENERIC] == 1:
        apply(c, z, u)
        call_rhs(c[OUT], t, z, floats(c[U]), floats(c[P]), outputs)
    for k in range(c[M]):
        if kinds[k] == 0:
            y[k] = z[indices[k]]
        elif kinds[k] == 1:
            y[k] = dz[indices[k]]
        else:
            y[k] = outputs[indices[k]]


@inner
def reading_rows(c, t, z, u, jac, rows, outputs):
    """Write the derivative of the channels into rows, from the Jacobian of the rates where they are rates.

    ``outputs`` is workspace for the derivative of all outputs.
    """
    kinds, indices, ld = ints(c[CHANNEL_KIND]), ints(c[CHANNEL_INDEX]), c[LD]
    if c[GENERIC] == 1:
        count = 0
        for k in range(c[M]):
            if kinds[k] == 2:
                count = max(count, indices[k] + 1)
        if c[OUT_W] != 0:
            tangent_at_once(c, OUT_W, t, z, u, outputs)
        elif c[EXACT] == 1:
            tangent_columns(c, OUT_T, count, t, z, u, outputs)
        else:
            difference_columns(c, OUT, count, t, z, u, outputs)
    for k in range(c[M]):
        i = indices[k]
        for j in range(ld):
            if kinds[k] == 0:
                rows[k * ld + j] = 1.0 if j == i else 0.0
            elif kinds[k] == 1:
                rows[k * ld + j] = jac[i * ld + j]
            else:
                rows[k * ld + j] = outputs[i * ld + j]


@inner
def has_rates(c):
    """Return whether a channel is the rate of a state."""
    kinds = ints(c[CHANNEL_KIND])
    rated = False
    for k in range(c[M]):
        rated = rated or kinds[k] == 1
    return rated


@inner
def step(c, t, h, z, u, u_mid, u_end, k, work):
    """Propagate z over h by Runge and Kutta's method of order 4; k holds four rows, work one."""
    n = c[ALL]
    k_2, k_3, k_4 = shift(k, n), shift(k, 2 * n), shift(k, 3 * n)
    rates(c, t, z, u, k)
    for i in range(n):
        work[i] = z[i] + 0.5 * h * k[i]
    rates(c, t + 0.5 * h, work, u_mid, k_2)
    for i in range(n):
        work[i] = z[i] + 0.5 * h * k_2[i]
    rates(c, t + 0.5 * h, work, u_mid, k_3)
    for i in range(n):
        work[i] = z[i] + h * k_3[i]
    rates(c, t + h, work, u_end, k_4)
    for i in range(n):
        z[i] += h / 6.0 * (k[i] + 2.0 * (k_2[i] + k_3[i]) + k_4[i])


@inner
def inputs_between(c, before, after, hold, share, out):
    """Write the inputs at a share of the way between two rows."""
    for i in range(c[N_U]):
        out[i] = before[i] if hold else before[i] + share * (after[i] - before[i])


@inner
def count_substeps(c, t, h, z, u, least):
    """Return the number of steps of an interval, so many that none passes more than half of a narrow feature."""
    count = least
    largest = floats(c[LARGEST])[0]
    if h > count * largest:
        count = int(min(math.ceil(h / largest), MOST_SUBSTEPS))
    if c[N_SPEEDS] > 0:
        speeds = floats(c[PACES])
        apply(c, z, u)
        call_rhs(c[SPEEDS], t, z, floats(c[U]), floats(c[P]), speeds)
        needed = h / half_passed(c[N_SPEEDS], speeds, floats(c[WIDTHS]))
        if needed > count:
            count = int(min(math.ceil(needed), MOST_SUBSTEPS))
    return count


@inner
def propagate(c, t, h, z, before, after, hold, substeps, u, k, work):
    """Propagate z over an interval between two rows of inputs; u holds three rows, k four, work one."""
    width = c[N_U]
    u_mid, u_end = shift(u, width), shift(u, 2 * width)
    part = h / substeps
    for s in range(substeps):
        inputs_between(c, before, after, hold, s / substeps, u)
        inputs_between(c, before, after, hold, (s + 0.5) / substeps, u_mid)
        inputs_between(c, before, after, hold, (s + 1.0) / substeps, u_end)
        step(c, t + s * part, part, z, u, u_mid, u_end, k, work)
