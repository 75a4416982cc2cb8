"""Four machines from nothing but a CSV file to the effect that a textbook model of them lacks.

The recordings are made by plain equations, with noise and rounding of the sensors: none of the package's own models is
asked.  What follows is what a person types: `vtsdt init`, which finds out the rest, `vtsdt check` and `vtsdt diagnose`.

    python examples/from_a_csv.py [FOLDER]
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from vtsdt.cli import main as vtsdt

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Machine:
    """A machine: how it moves in truth, what its logger writes, and what is missing from a textbook's model of it.

    Parameters
    ----------
    kind : str
        As ``vtsdt init --machine`` takes it.
    missing : str
        The effect, as kind@where.
    record : callable
        Takes a random generator, returns names and columns.
    """

    kind: str
    missing: str
    record: Callable[[np.random.Generator], dict[str, Array]]


def steps(rng: np.random.Generator, t: Array, low: float, high: float, hold: float, smooth: float) -> Array:
    """Return levels between ``low`` and ``high``, each held for ``hold`` seconds, smoothed over ``smooth`` seconds."""
    levels = rng.uniform(low, high, int(t[-1] / hold) + 2)
    width = max(int(smooth / (t[1] - t[0])), 1)
    held = levels[(t / hold).astype(int)]
    return np.convolve(np.pad(held, width, mode="edge"), np.ones(width) / width, mode="same")[width:-width]


def simulate(rates: Callable[[float, Array], list[float]], start: list[float], t: Array) -> Array:
    """Return the states at the times t, one row each."""
    return solve_ivp(rates, (t[0], t[-1]), start, t_eval=t, rtol=1e-8, atol=1e-10, max_step=0.5).y


def screw(rng: np.random.Generator) -> dict[str, Array]:
    """A carriage of 34 kg on a screw of 10 mm lead, with dry friction in its guide."""
    t = np.arange(0.0, 12.0, 0.004)
    torque = steps(rng, t, -0.16, 0.16, 0.4, 0.08)
    per_turn = 2.0 * np.pi / 0.010

    def rates(now: float, x: Array) -> list[float]:
        force = per_turn * np.interp(now, t, torque) - 150.0 * x[1] - 6.0 * np.tanh(x[1] / 1e-3)
        return [x[1], force / 34.0]

    x, v = simulate(rates, [0.0, 0.0], t)
    return {
        "Time [s]": t,
        "Motor torque [Nm]": torque,
        "Carriage position [mm]": np.round(1e3 * x + rng.normal(0.0, 2e-3, t.size), 3),
        "Carriage speed [mm/s]": np.round(1e3 * v + rng.normal(0.0, 0.3, t.size), 2),
    }


def shaft(rng: np.random.Generator) -> dict[str, Array]:
    """A motor that turns a fan through an elastic shaft; the drag of the air grows with the square of the speed."""
    t = np.arange(0.0, 12.0, 0.002)
    torque = steps(rng, t, 0.5, 6.0, 0.5, 0.008)

    def rates(now: float, x: Array) -> list[float]:
        twist, motor, load = x
        passed = 12.0 * twist + 0.02 * (motor - load)
        drag = 0.05 * load + 2e-4 * load * abs(load)
        return [motor - load, (np.interp(now, t, torque) - passed) / 2.5e-3, (passed - drag) / 8e-3]

    _, motor, load = simulate(rates, [0.0, 20.0, 20.0], t)
    return {
        "t_s": t,
        "M_motor_Nm": torque,
        "n_motor_rpm": np.round(30.0 / np.pi * motor + rng.normal(0.0, 0.5, t.size), 1),
        "n_load_rpm": np.round(30.0 / np.pi * load + rng.normal(0.0, 0.5, t.size), 1),
    }


def tanks(rng: np.random.Generator) -> dict[str, Array]:
    """Two tanks, one above the other; the upper one leaks through a crack."""
    t = np.arange(0.0, 3000.0, 2.0)
    flow = steps(rng, t, 0.9e-4, 1.9e-4, 150.0, 10.0)

    def rates(now: float, x: Array) -> list[float]:
        upper, lower = np.maximum(x, 1e-9)
        drained, out = 4.2e-5 * np.sqrt(19.62 * upper), 4.0e-5 * np.sqrt(19.62 * lower)
        return [(np.interp(now, t, flow) - drained - 3e-5 * upper) / 0.03, (drained - out) / 0.025]

    upper, lower = simulate(rates, [0.4, 0.4], t)
    return {
        "time_s": t,
        "pump [l/min]": np.round(6e4 * flow, 4),
        "level upper [cm]": np.round(1e2 * upper + rng.normal(0.0, 0.05, t.size), 2),
        "level lower [cm]": np.round(1e2 * lower + rng.normal(0.0, 0.05, t.size), 2),
    }


def oven(rng: np.random.Generator) -> dict[str, Array]:
    """A small oven that loses heat through its wall, and by radiation, which grows with the fourth power."""
    t = np.arange(0.0, 7200.0, 5.0)
    power = steps(rng, t, 0.0, 900.0, 500.0, 20.0)
    air = 293.15 + 2.0 * np.sin(2.0 * np.pi * t / 5000.0)

    def rates(now: float, x: Array) -> list[float]:
        outside = np.interp(now, t, air)
        lost = 1.5 * (x[0] - outside) + 2.5e-9 * (x[0] ** 4 - outside**4)
        return [(np.interp(now, t, power) - lost) / 3500.0]

    (inside,) = simulate(rates, [330.0], t)
    return {
        "t [s]": t,
        "heater_power_W": power,
        "ambient [°C]": np.round(air - 273.15 + rng.normal(0.0, 0.02, t.size), 2),
        "oven [°C]": np.round(inside - 273.15 + rng.normal(0.0, 0.1, t.size), 2),
    }


MACHINES = (
    Machine("heated-body", "radiation_loss@body", oven),
    Machine("screw-drive", "coulomb_friction@guide", screw),
    Machine("elastic-load", "quadratic_drag@bearing", shaft),
    Machine("tanks", "laminar_leakage@upper", tanks),
)


def start(machine: Machine, folder: Path) -> Path:
    """Write one recording and start a study from it; return the study's path."""
    columns = machine.record(np.random.default_rng(31))
    table = folder / f"{machine.kind}.csv"
    np.savetxt(table, np.column_stack(list(columns.values())), "%.9g", ",", header=",".join(columns), comments="")
    out = folder / machine.kind
    run("init", str(table), "--machine", machine.kind, "--out", str(out))
    return out / "study.toml"


def run(*words: str) -> None:
    """Run a command as a person types it."""
    print(f"$ vtsdt {' '.join(words)}", flush=True)
    if (code := vtsdt(list(words))) != 0:
        raise SystemExit(code)


def diagnose(study: Path) -> dict[str, Any]:
    """Check and diagnose a study; return its diagnosis."""
    run("check", str(study), "--out", str(study.parent / "check"))
    run("diagnose", str(study), "--out", str(study.parent / "diagnosis"))
    return dict(json.loads((study.parent / "diagnosis" / "diagnosis.json").read_text(encoding="utf-8")))


def name(effect: dict[str, Any]) -> str:
    """Return the name of an effect of a diagnosis, as kind@where."""
    return f"{effect['kind']}@{effect['where']}"


def was_found(machine: Machine, diagnosis: dict[str, Any]) -> bool:
    """Return whether a diagnosis names what is missing, alone or among effects that the recording cannot tell apart."""
    return any(
        machine.missing in [name(each) for each in (effect, *effect["indistinguishable_from"])]
        for effect in diagnosis["effects"]
    )


def outcome(machine: Machine, diagnosis: dict[str, Any]) -> str:
    """Return in words what was missing, what was named, and the error before and after on rows that were not fitted."""
    first, *_, last = (stage["validate"] for stage in diagnosis["stages"])
    units = diagnosis["units"]
    errors = [f"{n} {first[n]['rmse']:.3g} -> {last[n]['rmse']:.3g} {units.get(n, '')}".rstrip() for n in first]
    named = []
    for effect in diagnosis["effects"]:
        others = [name(each) for each in effect["indistinguishable_from"]]
        named.append(name(effect) + (f" (or {', '.join(others)}: not to be told apart)" if others else ""))
    lead = "found" if was_found(machine, diagnosis) else "NOT FOUND"
    return (
        f"{machine.kind}: {machine.missing} is missing: {lead}\n"
        f"  verdict: {diagnosis['verdict']}; named: {'; '.join(named) or 'nothing'}\n"
        f"  error on the rows held out, as given -> at the end: {', '.join(errors)}"
    )


def main(folder: Path) -> int:
    """Take the machines from their files to the named effect, say how each ended, return how many were not found."""
    folder.mkdir(parents=True, exist_ok=True)
    told, lost = [], 0
    for machine in MACHINES:
        begun = time.perf_counter()
        found = diagnose(start(machine, folder))
        told.append(f"{outcome(machine, found)}\n  {time.perf_counter() - begun:.0f} s")
        lost += not was_found(machine, found)
        print()
    print(*told, f"{len(MACHINES) - lost} of {len(MACHINES)} effects were found", sep="\n")
    return lost


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))
