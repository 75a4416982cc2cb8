"""Initial value problems with published end values.

Stiff problems and the Pleiades: Mazzia and Magherini, Test Set for Initial Value Problem Solvers, release 2.4,
University of Bari, 2008 (computed there in extended precision with tolerances of 1e-18); problems from Hairer and
Wanner, Solving Ordinary Differential Equations II, IV.10.  Arenstorf orbit: Hairer, Nørsett and Wanner, Solving
Ordinary Differential Equations I, II.0.
"""

from __future__ import annotations

from typing import Any

from multibody.compile import native
from multibody.inputs.table import InputTable
from multibody.solvers import NativeProblem

SOURCE = """
def van_der_pol(t, x, u, p, dx):
    dx[0] = x[1]
    dx[1] = ((1.0 - x[0] * x[0]) * x[1] * p[1] - x[0]) * p[0]


def van_der_pol_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):
    out[0] = x_dot[1]
    out[1] = ((1.0 - x[0] * x[0]) * x_dot[1] * p[1] - 2.0 * x[0] * x_dot[0] * x[1] * p[1] - x_dot[0]) * p[0]


def robertson(t, x, u, p, dx):
    slow = 0.04 * x[0]
    back = 1e4 * x[1] * x[2]
    fast = 3e7 * x[1] * x[1]
    dx[0] = -slow + back
    dx[1] = slow - back - fast
    dx[2] = fast


def robertson_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):
    slow = 0.04 * x_dot[0]
    back = 1e4 * (x_dot[1] * x[2] + x[1] * x_dot[2])
    fast = 6e7 * x[1] * x_dot[1]
    out[0] = -slow + back
    out[1] = slow - back - fast
    out[2] = fast


def oregonator(t, x, u, p, dx):
    dx[0] = 77.27 * (x[1] + x[0] * (1.0 - 8.375e-6 * x[0] - x[1]))
    dx[1] = (x[2] - (1.0 + x[0]) * x[1]) / 77.27
    dx[2] = 0.161 * (x[0] - x[2])


def oregonator_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):
    inner = 1.0 - 8.375e-6 * x[0] - x[1]
    out[0] = 77.27 * (x_dot[1] + x_dot[0] * inner + x[0] * (-8.375e-6 * x_dot[0] - x_dot[1]))
    out[1] = (x_dot[2] - x_dot[0] * x[1] - (1.0 + x[0]) * x_dot[1]) / 77.27
    out[2] = 0.161 * (x_dot[0] - x_dot[2])


def hires(t, x, u, p, dx):
    both = 280.0 * x[5] * x[7]
    dx[0] = -1.71 * x[0] + 0.43 * x[1] + 8.32 * x[2] + 0.0007
    dx[1] = 1.71 * x[0] - 8.75 * x[1]
    dx[2] = -10.03 * x[2] + 0.43 * x[3] + 0.035 * x[4]
    dx[3] = 8.32 * x[1] + 1.71 * x[2] - 1.12 * x[3]
    dx[4] = -1.745 * x[4] + 0.43 * x[5] + 0.43 * x[6]
    dx[5] = -both + 0.69 * x[3] + 1.71 * x[4] - 0.43 * x[5] + 0.69 * x[6]
    dx[6] = both - 1.81 * x[6]
    dx[7] = -both + 1.81 * x[6]


def hires_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):
    both = 280.0 * (x_dot[5] * x[7] + x[5] * x_dot[7])
    out[0] = -1.71 * x_dot[0] + 0.43 * x_dot[1] + 8.32 * x_dot[2]
    out[1] = 1.71 * x_dot[0] - 8.75 * x_dot[1]
    out[2] = -10.03 * x_dot[2] + 0.43 * x_dot[3] + 0.035 * x_dot[4]
    out[3] = 8.32 * x_dot[1] + 1.71 * x_dot[2] - 1.12 * x_dot[3]
    out[4] = -1.745 * x_dot[4] + 0.43 * x_dot[5] + 0.43 * x_dot[6]
    out[5] = -both + 0.69 * x_dot[3] + 1.71 * x_dot[4] - 0.43 * x_dot[5] + 0.69 * x_dot[6]
    out[6] = both - 1.81 * x_dot[6]
    out[7] = -both + 1.81 * x_dot[6]


def pleiades(t, x, u, p, dx):
    for i in range(14):
        dx[i] = x[14 + i]
        dx[14 + i] = 0.0
    for i in range(7):
        for j in range(7):
            if i != j:
                a = x[j] - x[i]
                b = x[7 + j] - x[7 + i]
                cubed = (a * a + b * b) ** 1.5
                dx[14 + i] += (j + 1.0) * a / cubed
                dx[21 + i] += (j + 1.0) * b / cubed


def arenstorf(t, x, u, p, dx):
    moon = 0.012277471
    earth = 1.0 - moon
    to_earth = ((x[0] + moon) * (x[0] + moon) + x[1] * x[1]) ** 1.5
    to_moon = ((x[0] - earth) * (x[0] - earth) + x[1] * x[1]) ** 1.5
    dx[0] = x[2]
    dx[1] = x[3]
    dx[2] = x[0] + 2.0 * x[3] - earth * (x[0] + moon) / to_earth - moon * (x[0] - earth) / to_moon
    dx[3] = x[1] - 2.0 * x[2] - earth * x[1] / to_earth - moon * x[1] / to_moon
"""

#: Name, parameters, start, end, reference, absolute tolerance at a relative tolerance of 1e-7.
Case = tuple[str, tuple[float, ...], list[float], float, list[float], float]
STIFF: dict[str, Case] = {
    "van_der_pol, mu = 1000": (
        "van_der_pol",
        (1.0, 1e3),
        [2.0, 0.0],
        2000.0,
        [0.1706167732170469e1, -0.8928097010248125e-3],
        1e-9,
    ),
    "van_der_pol, eps = 1e-6": (
        "van_der_pol",
        (1e6, 1.0),
        [2.0, 0.0],
        2.0,
        [0.1706167732170483e1, -0.8928097010247975],
        1e-9,
    ),
    "robertson": (
        "robertson",
        (0.0,),
        [1.0, 0.0, 0.0],
        1e11,
        [0.2083340149701255e-7, 0.8333360770334713e-13, 0.9999999791665050],
        1e-17,
    ),
    "oregonator": (
        "oregonator",
        (0.0,),
        [1.0, 2.0, 3.0],
        360.0,
        [0.1000814870318523e1, 0.1228178521549917e4, 0.1320554942846706e3],
        1e-9,
    ),
    "hires": (
        "hires",
        (0.0,),
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0057],
        321.8122,
        [
            0.7371312573325668e-3,
            0.1442485726316185e-3,
            0.5888729740967575e-4,
            0.1175651343283149e-2,
            0.2386356198831331e-2,
            0.6238968252742796e-2,
            0.2849998395185769e-2,
            0.2850001604814231e-2,
        ],
        1e-12,
    ),
}

#: The same of problems that are not stiff; the Arenstorf orbit is closed, so that its end is its start.
ORBIT = [0.994, 0.0, 0.0, -2.00158510637908252240537862224]
NOT_STIFF: dict[str, Case] = {
    "pleiades": (
        "pleiades",
        (0.0,),
        [
            *(3.0, 3.0, -1.0, -3.0, 2.0, -2.0, 2.0),
            *(3.0, -3.0, 2.0, 0.0, 0.0, -4.0, 4.0),
            *(0.0, 0.0, 0.0, 0.0, 0.0, 1.75, -1.5),
            *(0.0, 0.0, 0.0, -1.25, 1.0, 0.0, 0.0),
        ],
        3.0,
        [
            0.3706139143970502,
            0.3237284092057233e1,
            -0.3222559032418324e1,
            0.6597091455775310,
            0.3425581707156584,
            0.1562172101400631e1,
            -0.7003092922212495,
            -0.3943437585517392e1,
            -0.3271380973972550e1,
            0.5225081843456543e1,
            -0.2590612434977470e1,
            0.1198213693392275e1,
            -0.2429682344935824,
            0.1091449240428980e1,
            0.3417003806314313e1,
            0.1354584501625501e1,
            -0.2590065597810775e1,
            0.2025053734714242e1,
            -0.1155815100160448e1,
            -0.8072988170223021,
            0.5952396354208710,
            -0.3741244961234010e1,
            0.3773459685750630,
            0.9386858869551073,
            0.3667922227200571,
            -0.3474046353808490,
            0.2344915448180937e1,
            -0.1947020434263292e1,
        ],
        1e-7,
    ),
    "arenstorf orbit": ("arenstorf", (0.0,), ORBIT, 17.0652165601579625588917206249, ORBIT, 1e-7),
}


def make(name: str, p: tuple[float, ...], n: int, **options: Any) -> NativeProblem:
    """Return a problem of the source above, compiled."""
    module = native.load_source(SOURCE, "stiff_problems")
    tangent = native.compile_tangent(module, f"{name}_tangent") if f"{name}_tangent" in SOURCE else None
    return NativeProblem(
        rhs=native.compile_rhs(module, name), p=p, table=InputTable.constant([]), n=n, tangent=tangent, **options
    )
