"""``model.h``: what the C of a unit has to know of one model, its numbers and its equations."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from multibody.compile.c_source import C_ARITHMETIC, c_functions
from multibody.compile.emitter.kinds import FLOAT, FLOATS, Outside
from multibody.compile.emitter.units import unit_of_text
from multibody.compile.native import RHS_ARRAYS, TANGENT_ARRAYS
from multibody.fmi.errors import FmuError
from multibody.fmi.variables import Variables
from multibody.system.compiled import CompiledSystem
from multibody.system.narrow_features import StepLimits

__all__ = ["model_header"]

#: Tolerances of the integration, in a communication step and as the description recommends them for Model Exchange.
#: With them all machines of `benchmarks/fmu.py` come within 1e-4 of a tight simulation in every form; with 1e-6 some do
#: not.  They leave room for importers whose method accumulates more error than the one there (LSODA, measured too).
RELATIVE_TOLERANCE, ABSOLUTE_TOLERANCE = 1e-8, 1e-11

_HEADER = """\
/* {name}: numbers and equations.  Written by vtsdt; the other files are the same in every unit. */

#define TOKEN "{token}"
#define RELATIVE_TOLERANCE {rtol!r}
#define ABSOLUTE_TOLERANCE {atol!r}
#define LARGEST_STEP {largest}
#define N_SPEEDS {n_speeds}

enum {{ NX = {nx}, NU = {nu}, NP = {np}, NY = {ny} }};

static const double START[] = {{
{start}
}};
static const double NOMINAL[] = {{{nominal}}};
static const double WIDTH[] = {{{width}}};

{functions}"""


def model_header(
    system: CompiledSystem, variables: Variables, shown: tuple[int, ...], limits: StepLimits, token: str
) -> str:
    """Return the text of ``model.h``.

    Parameters
    ----------
    system : CompiledSystem
    variables : Variables
    shown : tuple of int
        Indices of the outputs that the unit has, in its order.
    limits : StepLimits
        What keeps a step from jumping over narrow features.
    token : str
        Of the model description.

    Raises
    ------
    FmuError
        If an equation has no form in C.
    """
    names = ["rhs", "outputs", "rhs_tangent", "outputs_tangent", *(["speeds"] if limits.widths else [])]
    texts = [C_ARITHMETIC]
    for name in names:
        arrays = TANGENT_ARRAYS if name.endswith("_tangent") else RHS_ARRAYS
        text = system.texts[name]
        if name.startswith("outputs"):
            text = _only(text, shown)
        try:
            made = c_functions(unit_of_text(text, name), name, (FLOAT, *[FLOATS] * arrays), f"model_{name}", "static")
        except Outside as error:
            raise FmuError(f"'{system.name}' cannot be written as C: {error}") from error
        texts.append(made)
    return _HEADER.format(
        name=system.name.replace("*/", ""),
        token=token,
        rtol=RELATIVE_TOLERANCE,
        atol=ABSOLUTE_TOLERANCE,
        largest=_c(limits.largest_step),
        n_speeds=len(system.speed_names) if limits.widths else 0,
        nx=len(variables.states),
        nu=len(variables.inputs),
        np=len(variables.parameters),
        ny=len(variables.outputs),
        start="\n".join(f"    {_c(v.start or 0.0)}, /* {v.reference} {v.name} */" for v in variables.all),
        nominal=_list(v.nominal or 1.0 for v in variables.states),
        width=_list(limits.widths.get(n, np.inf) for n in system.speed_names),
        functions="\n".join(texts),
    )


def _only(text: str, shown: tuple[int, ...]) -> str:
    """Return the text of a function of the outputs that writes only some, one after another."""
    place = {i: k for k, i in enumerate(shown)}
    lines = []
    for line in text.splitlines():
        for array in ("y", "out"):
            if line.startswith(f"    {array}["):
                index, _, rest = line[len(array) + 5 :].partition("]")
                line = f"    {array}[{place[int(index)]}]{rest}" if int(index) in place else ""
                break
        if line:
            lines.append(line)
    return "\n".join(lines) + "\n"


def _list(values: Iterable[float]) -> str:
    return ", ".join(map(_c, values)) or "0.0"  # C knows no empty array


def _c(value: float) -> str:
    return repr(float(value)) if np.isfinite(value) else "INFINITY" if value > 0 else "NAN"
