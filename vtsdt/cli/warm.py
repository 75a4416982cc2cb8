"""``vtsdt warm``: compile the shipped models before they are needed, once on a machine."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import TYPE_CHECKING

from multibody.base.progress import ProgressLine
from vtsdt.cli.arguments import CommandError, Parser

if TYPE_CHECKING:
    from multibody.machine.model import Model

__all__ = ["MODELS", "REHEARSALS", "main", "shipped", "warm"]

#: Parts of a compiled system, and what each is.
_PARTS = {
    "rhs_function": "rates",
    "outputs_function": "outputs",
    "rhs_tangent": "Jacobian of the rates",
    "rhs_columns": "its columns side by side",
    "outputs_tangent": "Jacobian of the outputs",
    "speeds_function": "speeds of what passes by",
}

#: The shipped models by name: the function that builds each.
MODELS = {
    "lift": "vtsdt.lift.lift:Lift.reference",
    "lift-1d": "vtsdt.lift.lift:Lift.one_dimensional",
    "lift-cabin": "vtsdt.lift.lift:Lift.cabin",
    "axis": "discrepancy.rigs.axis:build",
    "gear": "gearbox.stage.stage:GearStage.paper",
}

#: Commands that compile more than a model, by name: the function that runs each once.
REHEARSALS = {"align": "vtsdt.alignment.rehearsal:rehearse"}


def shipped(name: str) -> Model:
    """Return a shipped model by its name among `MODELS`."""
    module, _, path = MODELS[name].partition(":")
    return attrgetter(path)(importlib.import_module(module))()


def warm(names: Sequence[str], progress: Callable[[str], object]) -> dict[str, float]:
    """Compile models, commands and the integrators, and return the processor time of each, s.

    Parameters
    ----------
    names : sequence of str
        Of `MODELS` and `REHEARSALS`.
    progress : callable
        Takes a line of text.
    """
    from multibody.compile.batched_rates import batched_rhs
    from multibody.compile.vector_mode import MANY_LANES, along_directions
    from multibody.solvers import DormandPrince54, Rodas5P, integrate
    from multibody.solvers.batch import batch
    from multibody.solvers.kernels.dormand_prince_batched import LANES

    took = {}
    for name in names:
        begun = time.process_time()
        if name in REHEARSALS:
            progress(f"vtsdt {name}: rehearse")
            module, _, function = REHEARSALS[name].partition(":")
            getattr(importlib.import_module(module), function)()
            took[name] = time.process_time() - begun
            continue
        progress(f"{name}: assemble")
        system = shipped(name).build()
        for part, words in _PARTS.items():
            progress(f"{name}: {words}")
            native = getattr(system, part)
            if part.endswith("_tangent"):  # as simulations and Jacobians take it
                native = along_directions(native, MANY_LANES) or native
            if native is not None:  # several columns at once are not there where nothing is compiled
                native.compile()
        progress(f"{name}: rates of several runs at once")
        batched_rhs(system.rhs_function, LANES)
        took[name] = time.process_time() - begun
    begun = time.process_time()
    progress("integrators")
    problem, x0 = _small()
    batched_rhs(problem.rhs, LANES)
    for method in (DormandPrince54, Rodas5P):
        integrate(problem, (0.0, 0.1), x0, [0.1], method)
        integrate(problem, (0.0, 0.1), x0, [0.1], method, events=lambda t, x: x[0])
        for count in (1, LANES):
            list(batch([(problem, x0)] * count, (0.0, 0.1), [0.1], 1, method=method))
    took["integrators"] = time.process_time() - begun
    return took


def _small():  # type: ignore[no-untyped-def]
    """Return an oscillator that uses every feature of an integrator."""
    from multibody.library import Mass, Spring
    from multibody.machine.model import Model
    from multibody.system.simulate import input_table, native_problem

    model = Model("oscillator")
    body, spring = model.add("body", Mass(m=1.0, position=0.1)), model.add("spring", Spring(stiffness=100.0))
    model.connect(spring.a, model.ground)
    model.connect(spring.b, body.flange)
    system = model.build()
    system.outputs_along(*_one_row(system))
    system.linearize()
    table = input_table(system, None)
    return native_problem(system, system.p, table, tangent=True), system.start


def _one_row(system):  # type: ignore[no-untyped-def]
    import numpy as np

    return np.zeros(1), system.start[None], system.u[None], system.p


def main(arguments: Sequence[str]) -> int:
    """Run ``vtsdt warm``."""
    parser = Parser(
        prog="vtsdt warm", description="Compile the shipped models before they are needed; other processes find them."
    )
    known = [*MODELS, *REHEARSALS]
    parser.add_argument("models", nargs="*", metavar="MODEL", help=f"{', '.join(known)}; default: all")
    parser.add_argument("--quiet", action="store_true", help="say nothing")
    args = parser.parse_args(list(arguments))
    if unknown := [name for name in args.models if name not in known]:
        raise CommandError(f"there is no model '{unknown[0]}': take one of {', '.join(known)}")
    with ProgressLine(args.quiet) as progress:
        took = warm(args.models or known, progress)
    if not args.quiet:
        from multibody.base.cache import cache_dir

        width = max(map(len, took))
        print("\n".join(f"{name:<{width}}  {seconds:6.2f} s" for name, seconds in took.items()))
        print(f"kept in {cache_dir()}")
    return 0
