"""Exported units beside the systems that they were made from: deviation, speed, findings of other programs, leaks.

``python benchmarks/fmu.py [--page docs/benchmarks/fmu.md] [MACHINE ...]``

Asked besides FMPy, where they are installed: fmutool (``pip install 'vtsdt[peers]'``) and valgrind.
"""

from __future__ import annotations

import argparse
import ctypes
import datetime
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from runpy import run_path
from statistics import median
from typing import Any

import fmpy
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from fmu_forms import FORMS, TIGHT, VERSIONS, Case, beside, deviations

from multibody.fmi import c_model, description
from multibody.fmi.compiler import c_compiler

__all__ = ["MACHINES", "cycles_under_valgrind", "fmutool_findings", "warnings"]

BESIDE = Path(__file__).parent
EXAMPLES = BESIDE.parent / "examples"
BOUND = 1e-4  # of a state's or output's range: what is asked for
USUAL = (1e-6, 1e-9)  # tolerances of System.simulate
OWN = (c_model.RELATIVE_TOLERANCE, c_model.ABSOLUTE_TOLERANCE)  # of a unit that is asked for no others
ROUNDS = 5  # of timings that take turns
FIXED_STEP = 50e-6  # s, of the Runge-Kutta that Co-Simulation is laid beside
T = np.linspace(0.0, 1.0, 1001)

Machine = Callable[[], tuple[Any, Case]]


def _lift(kind: str) -> Machine:
    def machine() -> tuple[Any, Case]:
        from vtsdt.lift.lift import Lift

        lift = getattr(Lift, kind)()
        if "omega_ref" in lift.system.input_names:
            inputs = {n: (T, np.zeros_like(T)) for n in lift.system.input_names}
            inputs["omega_ref"] = (T, -0.5 * np.sin(np.pi * T / 2.0) ** 2)
        else:
            weight = lift.parameters.cabin.mass * 9.80665
            inputs = {"F_c": (T, weight + 20.0 * np.sin(2.0 * np.pi * T))}
        return lift.system, Case(until=1.0, step=1e-3, initial=lift.equilibrium().to_dict(), inputs=inputs)

    return machine


def _axis() -> tuple[Any, Case]:
    from discrepancy.rigs.axis_model import build

    inputs = {"reference.position": (T, 0.1 * np.sin(2.0 * np.pi * T) ** 2)}
    return build(coulomb=30.0).build(), Case(until=1.0, step=1e-3, inputs=inputs)


def _gear() -> tuple[Any, Case]:
    from gearbox.stage.stage import GearStage

    speed, load = 1000.0, 50.0  # r/min, N m
    t = np.linspace(0.0, 0.02, 201)
    inputs = {
        "speed": (t, np.full_like(t, speed * np.pi / 30.0)),
        "torque": (t, load + 5.0 * np.sin(100.0 * np.pi * t)),
    }
    return GearStage.paper().moving(speed, load).build(), Case(until=0.02, step=1e-4, inputs=inputs)


def _example(path: str) -> Any:
    return run_path(str(EXAMPLES / path))["build"]().build()


def _pendulum() -> tuple[Any, Case]:
    return _example("pendulum/pendulum.py"), Case(
        until=3.0, step=1e-2, initial={"rod.angle": np.pi + 1.0, "rod.speed": 0.0}
    )


def _clamp() -> tuple[Any, Case]:
    inputs = {"pump.flow": (T, 5e-5 * np.sin(2.0 * np.pi * T) ** 2)}
    return _example("clamp/clamp.py"), Case(until=1.0, step=1e-3, inputs=inputs)


def _motor_heat() -> tuple[Any, Case]:
    t = np.linspace(0.0, 1000.0, 1001)
    inputs = {
        "loss": (t, 200.0 * np.sin(2e-3 * np.pi * t) ** 2),
        "hall.temperature": (t, 293.15 + 2.0 * np.sin(2e-3 * t)),
    }
    return _example("motor_heat/motor_heat.py"), Case(until=1000.0, step=1.0, inputs=inputs)


#: Systems and how each is driven, by name.
MACHINES: dict[str, Machine] = {
    "lift": _lift("reference"),
    "lift, one-dimensional": _lift("one_dimensional"),
    "lift, cabin": _lift("cabin"),
    "axis": _axis,
    "gear stage": _gear,
    "pendulum (examples/pendulum)": _pendulum,
    "clamp (examples/clamp)": _clamp,
    "motor heat (examples/motor_heat)": _motor_heat,
}


def fmutool_findings(path: Path) -> list[str] | None:
    """Return what ``fmutool -check`` finds wrong, None where the program is not installed."""
    tool = shutil.which("fmutool")
    if tool is None:
        return None
    done = subprocess.run([tool, "-input", str(path), "-check"], capture_output=True, text=True, check=False)
    said = done.stdout + done.stderr
    found = [line.strip() for line in said.splitlines() if re.search(r"ERROR|WARNING|[1-9]\d* semantic error", line)]
    if "seems to be compliant" not in said:
        found.append("it does not say that the unit is compliant")
    return found


def warnings(path: Path) -> list[str]:
    """Return the warnings of the C compiler about a unit's source."""
    with tempfile.TemporaryDirectory() as folder:
        source = _sources(path, Path(folder))
        flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-c", "-o", f"{folder}/x.o"]
        done = subprocess.run([*_compiler(), *flags, str(source)], capture_output=True, text=True, check=True)
    return [line for line in done.stderr.splitlines() if "warning:" in line]


def cycles_under_valgrind(path: Path, folder: Path) -> str | None:
    """Return what valgrind says of a thousand starts and ends, empty if nothing; None where it is not installed."""
    if (valgrind := shutil.which("valgrind")) is None:
        return None
    program = cycles(path, folder, ["-g", "-O1"])
    strict = ["--quiet", "--leak-check=full", "--show-leak-kinds=all", "--errors-for-leak-kinds=all"]
    done = subprocess.run(
        [valgrind, *strict, "--error-exitcode=99", str(program)], capture_output=True, text=True, check=False
    )
    return done.stderr + (f"exit code {done.returncode}" if done.returncode else "")


def cycles(path: Path, folder: Path, flags: list[str]) -> Path:
    """Compile the program that starts and ends a unit a thousand times, and return it.

    Raises
    ------
    RuntimeError
        With the compiler's last line.
    """
    described = fmpy.read_model_description(str(path))
    second = described.fmiVersion == "2.0"
    token = described.guid if second else described.instantiationToken
    source = _sources(path, folder)
    program = folder / "cycles"
    given = [f'-DTOKEN_GIVEN="{token}"', *(["-DSECOND"] if second else [])]
    command = [*_compiler(), "-std=c99", *flags, *given, "-I", str(source.parent), "-o", str(program)]
    done = subprocess.run(
        [*command, str(BESIDE / "fmu_cycles.c"), str(source), "-lm"], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(done.stderr.strip().splitlines()[-1])
    return program


def _compiler() -> list[str]:
    found = c_compiler()
    if found is None:
        raise RuntimeError("no C compiler is found")
    return found


def _sources(path: Path, folder: Path) -> Path:
    """Unpack a unit's source, and return the file that is compiled."""
    with zipfile.ZipFile(path) as file:
        file.extractall(folder, [n for n in file.namelist() if n.startswith("sources/")])
    return next((folder / "sources").glob("fmi?.c"))


# -------------------------------------------------------------------- as a program


def _machine_lines(name: str, folder: Path) -> tuple[list[str], dict[str, float]]:
    """Return the lines of a machine, and the deviation of LSODA in each of its two units for Model Exchange."""
    from fmpy.validation import validate_fmu

    system, case = MACHINES[name]()
    lines, by_lsoda = [], {}
    for version in VERSIONS:
        path = system.to_fmu(folder / f"unit{version[0]}.fmu", fmi_version=version, initial=case.initial)
        tool = fmutool_findings(path)
        found = (
            f"{len(validate_fmu(str(path)))} | {'not installed' if tool is None else len(tool)} | {len(warnings(path))}"
        )
        loose = _loose_unit(system, folder / f"loose{version[0]}.fmu", version, case)
        for form in FORMS:
            tight = deviations(beside(system, path, form, case, TIGHT))
            worst = max(tight, key=tight.__getitem__)
            own = max(deviations(beside(system, path, form, case, TIGHT, OWN)).values())
            usual = max(deviations(beside(system, loose, form, case, TIGHT, USUAL)).values())
            pairs = [
                (beside(system, path, form, case, USUAL, OWN), beside(system, loose, form, case, USUAL, USUAL))
                for _ in range(ROUNDS)
            ]
            ratio = median(one.unit_time / one.native_time for one, _ in pairs)
            dearer = median(one.unit_time / other.unit_time for one, other in pairs)
            short = "ME" if form == "ModelExchange" else "CS"
            if short == "ME":
                found_by = deviations(beside(system, path, form, case, TIGHT, OWN, method="LSODA"))
                by_lsoda[f"{name}, FMI {version}"] = max(found_by.values())
            lines.append(
                f"| {name}, {len(system.states)} | {version} {short} | {tight[worst]:.1e} (`{worst}`) | {own:.1e} | "
                f"{usual:.1e} | {ratio:.1f} | {dearer:.1f} | {found} |"
            )
            print(lines[-1], flush=True)
    return lines, by_lsoda


def _loose_unit(system: Any, path: Path, version: str, case: Case) -> Path:
    """Write a unit whose own tolerances are those of `System.simulate`."""
    try:
        (c_model.RELATIVE_TOLERANCE, c_model.ABSOLUTE_TOLERANCE), description.RELATIVE_TOLERANCE = USUAL, USUAL[0]
        made: Path = system.to_fmu(path, fmi_version=version, initial=case.initial)
    finally:
        (c_model.RELATIVE_TOLERANCE, c_model.ABSOLUTE_TOLERANCE), description.RELATIVE_TOLERANCE = OWN, OWN[0]
    return made


def _step_lines(folder: Path) -> list[str]:
    """Return lines of the table of Dormand-Prince and Runge-Kutta on the lift with 37 states, both called from C."""
    system, case = MACHINES["lift"]()
    path = system.to_fmu(folder / "lift.fmu", fmi_version="2.0", initial=case.initial, binary=False)
    source = _sources(path, folder)
    library = folder / "steps.so"
    flags = ["-std=c99", "-O2", "-fPIC", "-shared", "-ffp-contract=off", "-I", str(source.parent)]
    subprocess.run([*_compiler(), *flags, "-o", str(library), str(BESIDE / "fmu_steps.c"), "-lm"], check=True)
    call = ctypes.CDLL(str(library)).all_steps
    pointer = ctypes.POINTER(ctypes.c_double)
    call.argtypes = [ctypes.c_long, ctypes.c_double, ctypes.c_long, ctypes.c_int, pointer, pointer]
    inputs = np.ascontiguousarray(np.column_stack([case.inputs[n][1] for n in system.input_names]))
    count = len(inputs) - 1
    run = system.simulate(case.until, step=case.step, initial=case.initial, inputs=case.inputs, rtol=1e-9, atol=1e-12)
    true = np.column_stack([run[n] for n in system.state_names])[1:]
    span = np.maximum(np.ptp(true, axis=0), 1e-9)
    fixed = round(case.step / FIXED_STEP)
    ways = {
        "Dormand-Prince with error control, inputs with derivatives (FMI 2.0)": (0, 1),
        "Dormand-Prince with error control, inputs held (FMI 3.0)": (0, 0),
        f"Runge-Kutta of order 4, steps of {FIXED_STEP * 1e6:.0f} µs, inputs held": (fixed, 0),
        f"Runge-Kutta of order 4, steps of {FIXED_STEP * 1e6:.0f} µs, inputs with derivatives": (fixed, 1),
    }
    found: dict[str, np.ndarray] = {way: np.empty((count, len(system.states))) for way in ways}
    took: dict[str, list[float]] = {way: [] for way in ways}
    for _ in range(ROUNDS):
        for way, (steps, sloped) in ways.items():
            begun = time.perf_counter()
            status = call(
                count, case.step, steps, sloped, inputs.ctypes.data_as(pointer), found[way].ctypes.data_as(pointer)
            )
            took[way].append(time.perf_counter() - begun)
            if status:
                raise RuntimeError(f"{way}: the integration stops")
    first = next(iter(ways))
    lines = []
    for way in ways:
        error = np.abs(found[way] - true) / span
        worst = system.state_names[int(np.argmax(error.max(axis=0)))]
        ratio = median(t / f for t, f in zip(took[way], took[first], strict=True))
        lines.append(f"| {way} | {error.max():.1e} (`{worst}`) | {ratio:.1f} |")
    return lines


def _cycle_lines(folder: Path) -> list[str]:
    system, case = MACHINES["lift"]()
    lines = []
    for version in VERSIONS:
        inside = folder / f"cycles{version[0]}"
        inside.mkdir()
        path = system.to_fmu(inside / "lift.fmu", fmi_version=version, initial=case.initial, binary=False)
        said = cycles_under_valgrind(path, inside)
        found = "not installed" if said is None else "nothing" if not said else f"`{said.strip().splitlines()[0]}`"
        lines.append(f"| {version} | {found} |")
    return lines


HEAD = """| machine, states | form | deviation, integrated tightly | at the unit's own {own:g} | at {usual:g} | time, \
native = 1 | time, at {usual:g} = 1 | fmpy validate | fmutool | warnings |
|---|---|---|---|---|---:|---:|---:|---:|---:|"""

PAGE = """# Exported units

Written on {date} at {commit} by `python benchmarks/fmu.py --page docs/benchmarks/fmu.md`;
{computer}; load of the {cores} cores meanwhile {load}.

Each machine is simulated by `System.simulate` and as a unit in four forms, FMI 2.0 and 3.0, Model Exchange (ME) and
Co-Simulation (CS). The deviation is the largest of all states and outputs at all samples, as a share of the range that
the state or output has; asked for is {bound:g}. `System.simulate` integrates with a relative tolerance of {tight:g}.
So does the unit where it is "integrated tightly", so that what is left is the unit's: {tightly}.
A unit that is asked for nothing else integrates with {own:g}, and recommends that for Model Exchange:
{ownly}. With {usual:g}, the usual tolerance of `System.simulate`:
{usually}. In Model Exchange SciPy's RK45 integrates, from sample to sample: inputs run straight between samples and
have a kink at each. LSODA, which looks back over many steps and goes on over the kinks, is an example of a method that
accumulates more error: with {own:g}, {lsoda}.
Findings are counted: of `fmpy validate`, of `fmutool -check`, and of the C compiler with `-Wall -Wextra`.

Times are processor times, the median ratio of {rounds} rounds in which the compared runs take turns: of the unit with
its own tolerance against `System.simulate` with {usual:g}, and against a unit with {usual:g}. By the second,
the tighter tolerance costs {costs}. A unit in Co-Simulation is
called through FMPy once for every sample, and every value is fetched: that is most of its time where the machine is
small. In Model Exchange each evaluation goes from SciPy through Python into the unit.

{head}
{machines}

Saving and putting back the state, reset, twenty instances side by side and the answers to wrong use are asserted in
`tests/unit/test_fmu_export.py` in both versions.

## The integrator of Co-Simulation

The lift with 37 states for 1 s in communication steps of 1 ms, called from C, beside the simulation with inputs that
run straight between samples, integrated tightly. Deviation as above, of the states; times are the median of {rounds}
rounds.

| way | deviation | time |
|---|---|---:|
{steps}

## A thousand starts and ends

Of the lift with 37 states, each with a step, a saved state that is put back and freed, and a step that is refused
(`benchmarks/fmu_cycles.c`); what valgrind finds with every kind of leak counted:

| FMI | found |
|---|---|
{cycles}
"""


def main() -> None:
    """Measure, print, and write the page."""
    from run import machine as computer

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("machines", nargs="*", metavar="MACHINE", help=f"of {', '.join(MACHINES)}")
    parser.add_argument("--page", metavar="FILE", type=Path, help="write this page of the docs")
    args = parser.parse_args()
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False).stdout
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        lines, by_lsoda = [], {}
        for k, machine in enumerate(args.machines or MACHINES):
            inside = folder / str(k)
            inside.mkdir()
            found, others = _machine_lines(machine, inside)
            lines += found
            by_lsoda |= others
        steps = _step_lines(folder)
        cycle = _cycle_lines(folder)
    print(*steps, *cycle, sep="\n")
    if args.page is None:
        return

    def range_of(form: str) -> str:
        ratios = [float(line.split("|")[7]) for line in lines if form in line.split("|")[2]]
        return f"{min(ratios):.1f} to {max(ratios):.1f} times in {form}"

    def kept(column: int) -> str:
        over = sum(float(line.split("|")[column].split()[0]) > BOUND for line in lines)
        return f"{over} of {len(lines)} are above the bound" if over else "all keep the bound"

    worst = max(by_lsoda, key=by_lsoda.__getitem__)
    beyond = sum(v > BOUND for v in by_lsoda.values())
    args.page.write_text(
        PAGE.format(
            date=datetime.date.today().isoformat(),
            commit=commit.strip() or "unknown",
            computer=computer(),
            load=f"{os.getloadavg()[0]:.0f}",
            cores=os.cpu_count(),
            bound=BOUND,
            tight=TIGHT[0],
            usual=USUAL[0],
            own=OWN[0],
            tightly=kept(3),
            ownly=kept(4),
            usually=kept(5),
            lsoda=f"{beyond} of {len(by_lsoda)} are above the bound, the largest {by_lsoda[worst]:.1e} ({worst})",
            costs=f"{range_of('ME')} and {range_of('CS')}",
            rounds=ROUNDS,
            head=HEAD.format(own=OWN[0], usual=USUAL[0]),
            machines="\n".join(lines),
            steps="\n".join(steps),
            cycles="\n".join(cycle),
        ),
        encoding="utf-8",
    )


if __name__ == "__main__":
    main()
