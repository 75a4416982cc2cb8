"""Numbers against published ones and closed forms: calibration, solvers, energy, filters; writes the page.

``python benchmarks/certified_numbers.py [--only calibration,solvers,energy,filters]
[--page docs/benchmarks/certified-numbers.md]``
"""

from __future__ import annotations

import argparse
import datetime
import importlib.util
import re
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "physics"))

import steady_filters
import test_library
from certified_regression import MODELS, Dataset, digits, digits_at, fit, read
from reference_problems import NOT_STIFF, STIFF, make
from test_started_machines import SIZES, started

from discrepancy.rigs import axis_model
from discrepancy.starters.kinds import KINDS
from discrepancy.validation.source_hash import source_hash
from estimation import Record
from estimation.files.record import RecordedSignal
from estimation.fit.calibrate import Calibration, UncertainParameter, calibrate
from estimation.response.experiment import Experiment
from gearbox.stage.stage import GearStage
from multibody import Model
from multibody.solvers import Automatic, DormandPrince54, Rodas5P, integrate
from vtsdt.lift.lift import Lift

ROOT = Path(__file__).resolve().parents[1]
#: Simulations a fit may take: more than a study grants, because starts are far away here.
EVALUATIONS = 1000

COMPONENT = '''
import math

from multibody import Component
from multibody.declare.declarations import Input, Output, Parameter


class Regression(Component):
    """A response that depends on predictors alone."""

{declared}
    y = Output("1", "response")

    def equations(self):
{read}
        self.y = {equation}
'''


def _load(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


# ---------------------------------------------------------------- calibration


def calibration() -> list[str]:
    """Return the table of NIST's regressions: by the least squares alone, and by a calibration of a compiled model."""
    lines = [
        "| set, difficulty | start | least squares: parameters | deviations | squares | evaluations "
        "| calibration: parameters | deviations | squares | evaluations | off by [deviations] |",
        "| --- | ---: " + "| ---: " * 9 + "|",
    ]
    with tempfile.TemporaryDirectory() as folder:
        for name in MODELS:
            dataset = read(name)
            component = _component(dataset, Path(folder))
            for k, start in enumerate(dataset.starts, 1):
                found = fit(dataset, start, tolerance=1e-14, max_evaluations=EVALUATIONS)
                fitted = _calibrated(dataset, component, start)
                cells = [
                    *_cells(dataset, found.x, found.evaluations),
                    *_cells(dataset, fitted.values, fitted.evaluations),
                    f"{np.max(np.abs(fitted.values - dataset.certified) / dataset.deviations):.2g}",
                ]
                lines.append(f"| {name}, {dataset.level} | {k} | {' | '.join(cells)} |")
    return lines


def _cells(dataset: Dataset, b: np.ndarray, evaluations: int) -> list[str]:
    d = digits_at(dataset, b)
    return [f"{d.parameters:.1f}", f"{d.deviations:.1f}", f"{d.squares:.1f}", str(evaluations)]


def _component(dataset: Dataset, folder: Path) -> Any:
    names = [f"b{k + 1}" for k in range(dataset.certified.size)]
    declared = [f'    {n} = Parameter(None, "1", "parameter")' for n in names]
    declared += [f'    {n} = Input("1", "predictor")' for n in dataset.x]
    text = COMPONENT.format(
        declared="\n".join(declared),
        read="\n".join(f"        {n} = self.{n}" for n in (*names, *dataset.x)),
        equation=re.sub(r"\b(exp|cos|sin|atan|pi)\b", r"math.\1", MODELS[dataset.name]),
    )
    path = folder / f"regression_{dataset.name.lower()}.py"
    path.write_text(text, encoding="utf-8")
    return _load(path).Regression


def _calibrated(dataset: Dataset, component: Any, start: np.ndarray) -> Calibration:
    values = {f"b{k + 1}": float(v) for k, v in enumerate(start)}
    model = Model(dataset.name)
    part = model.add("set", component(**values))
    for n in dataset.x:
        model.input(n, getattr(part, n))
    signals = {n: RecordedSignal(values=x, unit="", column=n, measured_unit="") for n, x in dataset.x.items()}
    signals["set.y"] = RecordedSignal(values=dataset.y, unit="", column="y", measured_unit="")
    rows = np.arange(dataset.y.size, dtype=float)
    record = Record(name=dataset.name, path=Path(f"{dataset.name}.dat"), time=rows, signals=signals)
    experiment = Experiment(record=record, inputs=tuple(dataset.x), outputs=("set.y",))
    uncertain = [UncertainParameter(name=f"set.{n}", value=v) for n, v in values.items()]
    return calibrate(model.build(), [experiment], uncertain, max_evaluations=EVALUATIONS)


# ---------------------------------------------------------------- solvers


def solvers() -> list[str]:
    """Return the table of end values of initial value problems."""
    lines = ["| problem | method | rtol 1e-6 | 1e-9 | 1e-12 |", "| --- | --- | ---: | ---: | ---: |"]
    for cases, methods in (
        (STIFF, (Automatic, Rodas5P, "Radau")),
        (NOT_STIFF, (Automatic, DormandPrince54, "DOP853")),
    ):
        for case, (name, p, x0, end, reference, atol) in cases.items():
            for method in methods:
                cells = []
                for rtol in (1e-6, 1e-9, 1e-12):
                    problem = make(name, p, len(x0))
                    done = integrate(problem, (0.0, end), x0, [end], method, rtol=rtol, atol=atol * rtol / 1e-7)
                    cells.append(f"{_digits_of_end(done.y[:, -1], np.array(reference)):.1f}")
                called = f"SciPy's {method}" if isinstance(method, str) else method.__name__
                lines.append(f"| {case} | {called} | {' | '.join(cells)} |")
    return lines


def _digits_of_end(found: np.ndarray, reference: np.ndarray) -> float:
    """Return the digits of the worst component, by its own size; by the largest one's where it is zero."""
    size = np.where(reference == 0.0, np.max(np.abs(reference)), np.abs(reference))
    return float(-np.log10(np.max(np.abs(found - reference) / size)))


# ---------------------------------------------------------------- energy


def energy() -> list[str]:
    """Return the table of energy balances."""
    lines = [
        "| machine | components | turned over [J] | largest residual [J] | share |",
        "| --- | ---: | ---: | ---: | ---: |",
    ]
    for name, components, run in _runs():
        stored, lost, supplied = (run[f"energy.{n}"] - run[f"energy.{n}"][0] for n in ("stored", "lost", "supplied"))
        residual = float(np.max(np.abs(stored + lost - supplied)))
        turned = float(np.max(np.abs(lost)) + np.max(np.abs(supplied)) + np.ptp(stored))
        share = f"{residual / turned:.0e}" if turned else "0"
        lines.append(f"| {name} | {components} | {turned:.3g} | {residual:.1e} | {share} |")
    return lines


def _runs() -> Iterator[tuple[str, int, Any]]:
    tight = {"rtol": 1e-10, "atol": 1e-12}
    for family in test_library.FAMILIES:
        model = test_library.model_of(family)
        yield f"library: {family.__name__}", len(model.components), model.build(energy=True).simulate(1.0, **tight)
    yield from _driven("virtual axis", axis_model.build(coulomb=20.0))
    for name in ("clamp", "emps", "lead_screw", "motor_heat"):
        yield from _driven(f"example: {name}", _load(ROOT / "examples" / name / f"{name}.py").build())
    swing = _load(ROOT / "examples" / "pendulum" / "pendulum.py").build()
    run = swing.build(energy=True).simulate(2.0, initial={"rod.angle": 2.0}, **tight)
    yield "example: pendulum", len(swing.components), run
    with tempfile.TemporaryDirectory() as folder:
        for kind in KINDS.values():
            yield from _driven(f"init: {kind.name}", started(kind, Path(folder)))
    given: dict[str, Any] = {
        "friction_c": -3.0,
        "friction_cw": 2.0,
        "tau_L": 0.0,
    }  # friction is an input of the one-dimensional model
    for name, lift, inputs in (
        ("lift of 37 states", Lift.reference(profile=True), ()),
        ("lift of 17 states", Lift.one_dimensional(), ("friction_c", "friction_cw", "tau_L")),
        ("lift's cabin of 12 states", Lift.cabin(), ("F_c",)),
    ):
        if "F_c" in inputs:
            given["F_c"] = (run.times, run["F_c"])
        run = lift.trip(
            "up", system=lift.build(energy=True), inputs={n: given[n] for n in inputs}, rtol=1e-8, atol=1e-11
        )
        yield name, len(lift.components), run
    stage = GearStage.paper()
    system = stage.build(
        energy=True, outputs=[*stage.outputs, *(f"energy.{n}" for n in ("stored", "lost", "supplied"))]
    )
    run = stage.simulate(1000.0, 150.0, 0.05, rate=20000.0, system=system, rtol=1e-7, atol=1e-11)
    yield "gear stage", len(stage.components), run


def _driven(name: str, model: Model) -> Iterator[tuple[str, int, Any]]:
    """Yield a machine driven by a slow wave on every input, about its default."""
    t = np.linspace(0.0, 2.0, 2001)
    system = model.build(energy=True)
    inputs = {q.name: (t, q.value + SIZES.get(q.unit, 1.0) * np.sin(2.0 * np.pi * t) ** 3) for q in system.inputs}
    yield name, len(model.components), system.simulate(2.0, inputs=inputs, rtol=1e-10, atol=1e-12)


# ---------------------------------------------------------------- filters


def filters() -> list[str]:
    """Return the table of settled filters."""
    lines = ["| filter | what | reached | closed form | digits |", "| --- | --- | ---: | ---: | ---: |"]
    for name, what, value, wanted in steady_filters.results():
        d = digits(np.array([value]), np.array([wanted]))
        lines.append(f"| {name} | {what} | {value:.12g} | {wanted:.12g} | {d:.1f} |")
    return lines


PARTS: dict[str, tuple[Callable[[], list[str]], str]] = {
    "calibration": (
        calibration,
        """## Calibration: NIST's nonlinear regressions

All 27 sets of NIST's Statistical Reference Datasets, from both starts. A digit is one of the log relative error,
$-\\log_{10}(|b - b_\\text{certified}| / |b_\\text{certified}|)$, of the worst parameter, of the worst standard
deviation, and of the residual sum of squares; 11 are certified. "Least squares" is the minimiser that every calibration
uses, asked to go on until nothing improves; "calibration" is `estimation.fit.calibrate` on a compiled model whose only
component is the regression, with the tolerances that a study has and at most 1000 simulations a round: it stops where
a further step promises to lower the cost by less than a millionth. The last column says by how many certified standard
deviations its worst parameter is off; where a fit ends early in a long narrow valley that is much (Bennett5). The
deviations are those of the linearised model at the end, $s^2 (J^\\top J)^{-1}$. 0.0 says that the fit did not reach the
certified minimum.
Lanczos1 was generated without noise: its residuals are rounding, and so are its deviations and its sum of squares.
""",
    ),
    "solvers": (
        solvers,
        """## Solvers: published end values

Digits of the worst component at the end. References are those of the Test Set for Initial Value Problem Solvers (Bari)
and, for the closed Arenstorf orbit, its start (Hairer, Nørsett and Wanner). All go through `solve_ivp`, with equations
compiled by numba. Absolute tolerances are in proportion to the relative one (`tests/physics/reference_problems.py`).
Close encounters magnify errors in the last two problems, for every method alike; a negative number says that the error
is larger than what was computed.
""",
    ),
    "energy": (
        energy,
        """## Energy: stored + lost − supplied

The balance of whole machines, from what each component stores, loses and supplies; what is turned over is the sum of
the largest lost and supplied energy and the range of the stored one. The machines of the library together contain every
component of the library but the spatial ones, of which the lift and the gear stage have theirs. 0 conserves energy;
what is left is the error of the integration.
""",
    ),
    "filters": (
        filters,
        """## Filters: closed forms

Variances of settled filters, read at every step (`tests/physics/steady_filters.py`).
""",
    ),
}
PAGE = """# Certified numbers

Measured on {date}; hash of the sources {hash}; Python {python}, numpy {numpy}, scipy {scipy}, numba {numba}. Written
by `python benchmarks/certified_numbers.py --page docs/benchmarks/certified-numbers.md`. Nothing is drawn at random
but the readings of the filters, on which their variances do not depend (seed 0).

{parts}
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Compute the tables, print them, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", help=f"parts, separated by commas, of: {', '.join(PARTS)}")
    parser.add_argument("--page", type=Path)
    given = parser.parse_args(arguments)
    warnings.simplefilter("ignore", RuntimeWarning)  # trials far away overflow, and are refused
    parts = []
    for name in given.only.split(",") if given.only else PARTS:
        compute, text = PARTS[name]
        parts.append(f"{text}\n" + "\n".join(compute()))
        print(parts[-1], flush=True)
    if given.page:
        page = PAGE.format(
            date=datetime.date.today().isoformat(),
            hash=source_hash(
                "estimation.fit", "estimation.filters", "multibody.solvers", "vtsdt.lift", "gearbox.stage"
            ),
            python=sys.version.split()[0],
            parts="\n\n".join(parts),
            **{name: version(name) for name in ("numpy", "scipy", "numba")},
        )
        given.page.write_text(page.rstrip() + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
