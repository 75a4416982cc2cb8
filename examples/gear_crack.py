"""A growing tooth crack, followed over speeds and loads, with the model updated along (synthetic).

The virtual gear stage has errors of manufacturing, some of which the model lacks, its mesh becomes softer over the
year, and from day 150 on the root of one tooth cracks.  Every visit has another speed and another load.  The model of
the stage follows: each visit fits stiffness and errors of both gears anew, beginning where the visits before have
ended.  When it stops being right, the effect that has come in is searched among all teeth of both gears; from then on
its size is a parameter like the others, of all visits, and its trend is followed.  Run it with

    python examples/gear_crack.py --out out/gear-crack

Seven minutes on one processor.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gearbox import GearStage
from operation import Judgement, Quantity
from operation.follow.settings import FollowSettings
from operation.follow.watch import FoundChange, MachineState, watch

DAY, YEAR = 86400.0, 365.0
NEW_YEAR = 1767225600.0  # 2026-01-01
TEETH = {"1": 32, "2": 44}
CHANNELS = tuple(f"a_{seat}_{axis}" for seat in ("input_seat", "output_seat") for axis in "yz")
SPEEDS, LOADS = (800.0, 1200.0), (100.0, 200.0)  # r/min, N m
DURATION, RATE, NOISE = 0.5, 10e3, 0.3  # s, Hz, m/s²
STIFFNESS = 8.6e5
#: What is fitted at every visit, with the step of the differences.
ERRORS = [f"mesh.{kind}_{gear}" for gear in TEETH for kind in ("runout_x", "runout_y", "lobes_cos", "lobes_sin")]
FITTED = {"mesh.K": 1e-3 * STIFFNESS, **dict.fromkeys(ERRORS, 1e-6)}
CRACK_STEP = 0.02
#: Linearisations of a visit where the crack is fitted, whose effect bends: a tenth at a third of the stiffness.
ROUNDS = 2
#: The truth, m: one and two waves of each gear, which the model has and has to find, and three waves, which it lacks.
TRUE_ERRORS = {
    "mesh.runout_x_1": 5e-6,
    "mesh.runout_y_2": -4e-6,
    "mesh.lobes_cos_1": 3e-6,
    "mesh.lobes_sin_2": 3e-6,
    "mesh.lobes3_cos_1": 0.3e-6,
    "mesh.lobes3_sin_2": 0.3e-6,
}
#: Softening over the year; what the crack takes of the tooth by its end, which tooth, and from which day on.
SOFTER, CRACKED, TOOTH, BEGINS = 0.03, 0.4, 7, 150.0
#: Parts of a turn in an average over turns.
BINS = 352
#: Last visits on which the search is made.
SEARCHED = 3


@dataclass(frozen=True)
class Visit:
    """A visit: its day, speed (r/min), load (N m), angle of the shaft at the start, and the seed of its noise."""

    number: int
    day: float
    speed: float
    load: float
    angle: float
    seed: int

    @property
    def crack(self) -> float:
        """True share of its stiffness that the tooth has lost."""
        return CRACKED * max(self.day - BEGINS, 0.0) / (YEAR - BEGINS)

    @property
    def truth(self) -> dict[str, float]:
        """Parameters of the virtual stage on this day."""
        stiffness = STIFFNESS * (1.0 - SOFTER * self.day / YEAR)
        return {**TRUE_ERRORS, "mesh.K": stiffness, "mesh.crack_1": self.crack, "mesh.damaged_1": float(TOOTH)}


def visits(count: int, seed: int) -> list[Visit]:
    """Return visits at even times over a year, at random speeds and loads."""
    rng = np.random.default_rng([seed, 1])
    return [
        Visit(
            number=k + 1,
            day=(k + 0.5) * YEAR / count,
            speed=float(rng.uniform(*SPEEDS)),
            load=float(rng.uniform(*LOADS)),
            angle=float(rng.uniform(0.0, 2.0 * np.pi)),
            seed=seed,
        )
        for k in range(count)
    ]


def simulated(stage: GearStage, visit: Visit, parameters: Mapping[str, float]) -> np.ndarray:
    """Return the accelerations of a visit, one after the other."""
    run = stage.simulate(
        visit.speed, visit.load, DURATION, rate=RATE, parameters=parameters, angle=visit.angle, rtol=1e-6
    )
    return np.concatenate([run[c] for c in CHANNELS])


def recorded(stage: GearStage, visit: Visit) -> np.ndarray:
    """Return what the accelerometers of the virtual stage write."""
    true = simulated(stage, visit, visit.truth)
    return true + NOISE * np.random.default_rng([visit.seed, 2, visit.number]).standard_normal(true.size)


def sensitivities(
    stage: GearStage, visit: Visit, at: Mapping[str, float], steps: Mapping[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the model's accelerations and their differences by each parameter."""
    nominal = simulated(stage, visit, at)
    columns = [
        (simulated(stage, visit, {**at, name: at.get(name, 0.0) + step}) - nominal) / step
        for name, step in steps.items()
    ]
    return nominal, np.column_stack(columns)


def judged(stage: GearStage, visit: Visit, measured: np.ndarray, at: Mapping[str, float], gear: str = "") -> Judgement:
    """Fit the model to a visit alone; with ``gear`` the crack of that gear's tooth too."""
    steps = {**FITTED, **({f"mesh.crack_{gear}": CRACK_STEP} if gear else {})}
    scale, values = np.array(list(steps.values())), np.array([at.get(n, 0.0) for n in steps])
    for _ in range(ROUNDS if gear else 1):
        here = {**at, **dict(zip(steps, values.tolist(), strict=True))}
        nominal, columns = sensitivities(stage, visit, here, steps)
        change, *_ = np.linalg.lstsq(columns * scale, measured - nominal, rcond=None)
        values = values + scale * change
    left = measured - nominal - columns @ (scale * change)
    size = float(np.sqrt(np.mean(left**2)))
    std = size * scale * np.sqrt(np.diag(np.linalg.inv((columns * scale).T @ (columns * scale))))
    quantities = {
        name: Quantity(value=float(v), std=float(s), kind="parameter")
        for name, v, s in zip(steps, values, std, strict=True)
    }
    for name in TEETH:
        averaged = float(np.sqrt(np.mean(averaged_over_turns(left, visit, name) ** 2)))
        quantities[f"misfit over turns of gear {name}"] = Quantity(value=averaged, unit="m/s**2", kind="misfit")
    quantities["speed"] = Quantity(value=visit.speed, unit="r/min", kind="condition")
    quantities["load"] = Quantity(value=visit.load, unit="N*m", kind="condition")
    return Judgement(
        key=f"{visit.number}", name=f"visit {visit.number}", at=NEW_YEAR + visit.day * DAY, quantities=quantities
    )


def averaged_over_turns(residual: np.ndarray, visit: Visit, gear: str) -> np.ndarray:
    """Return the average of each channel over the turns of a gear, shape (channels, bins).

    What belongs to one tooth stays, noise falls with the number of turns, as in McFadden, Mechanical Systems and Signal
    Processing 1 (1987) 173.
    """
    count = residual.size // len(CHANNELS)
    turns = visit.angle / (2.0 * np.pi) + visit.speed / 60.0 * np.arange(count) / RATE
    at = (turns * TEETH["1"] / TEETH[gear] * BINS).astype(int) % BINS
    number = np.maximum(np.bincount(at, minlength=BINS), 1)
    channels = residual.reshape(len(CHANNELS), count)
    return np.stack([np.bincount(at, weights=y, minlength=BINS) / number for y in channels])


def level_of(state: MachineState | None, names: Sequence[str]) -> dict[str, float]:
    """Return where the visits so far leave some parameters: where the next fit begins."""
    if state is None:
        return {"mesh.K": STIFFNESS}
    return {n: state.traces[n].now[0] for n in names if n in state.traces}


def damaged_tooth(
    stage: GearStage, chosen: Sequence[tuple[Visit, np.ndarray]], at: Mapping[str, float]
) -> list[tuple[float, str, int, float]]:
    """Return how much a crack of every tooth would explain on some visits: likelihood gain, gear, tooth, size.

    The gain is that of the log likelihood with the crack over that of the model updated without it.
    """
    found = []
    bases = []
    for visit, measured in chosen:
        nominal, columns = sensitivities(stage, visit, at, FITTED)
        basis = np.linalg.qr(columns * np.array(list(FITTED.values())))[0]
        bases.append((visit, nominal, basis, _without(basis, measured - nominal)))
    for gear, count in TEETH.items():
        for tooth in range(count):
            along = energy = total = 0.0
            for visit, nominal, basis, left in bases:
                cracked = {**at, f"mesh.crack_{gear}": CRACK_STEP, f"mesh.damaged_{gear}": float(tooth)}
                shape = _without(basis, (simulated(stage, visit, cracked) - nominal) / CRACK_STEP)
                along, energy, total = along + shape @ left, energy + shape @ shape, total + left @ left
            gain = 0.5 * along**2 / energy / NOISE**2 if along > 0.0 else 0.0
            found.append((float(gain), gear, tooth, float(along / energy)))
    return sorted(found, reverse=True)


def _without(basis: np.ndarray, values: np.ndarray) -> np.ndarray:
    return values - basis @ (basis.T @ values)


@dataclass
class Followed:
    """What a year of visits has shown.

    Attributes
    ----------
    detected : float or None, days
        When the model was found to be no longer right.
    change : FoundChange or None
    named : list of (gain, gear, tooth, size)
        The teeth, the most likely first.
    state : MachineState
        With the crack among the parameters from when it was named.
    """

    detected: float | None = None
    change: FoundChange | None = None
    named: list[tuple[float, str, int, float]] | None = None
    state: MachineState | None = None


def follow(stage: GearStage, plan: Sequence[Visit], say=print) -> Followed:
    """Follow the stage through its visits."""
    settings = FollowSettings(machine="gear stage", drift={"mesh.K": 0.05 * STIFFNESS, "mesh.crack_1": 0.5})
    done: list[tuple[Visit, np.ndarray]] = []
    judgements: list[Judgement] = []
    found, gear, fixed = Followed(), "", {}
    for visit in plan:
        measured = recorded(stage, visit)
        done.append((visit, measured))
        names = [*FITTED, *([f"mesh.crack_{gear}"] if gear else [])]
        at = {**level_of(found.state, names), **fixed}
        judgements.append(judged(stage, visit, measured, at, gear))
        found.state = watch(judgements, settings)
        say(f"day {visit.day:3.0f}: {found.state.word}: {found.state.reasons[0]}")
        grown = [c for c in found.state.changes if c.kind == "misfit" and c.change.up]
        if grown and not gear:
            found.detected, found.change = visit.day, grown[0]
            found.named = damaged_tooth(stage, done[-SEARCHED:], at)
            gear, tooth = found.named[0][1:3]
            say(f"a crack of tooth {tooth} of gear {gear} explains most; all visits are judged with it")
            fixed = {f"mesh.damaged_{gear}": float(tooth)}
            start = {**at, **fixed}
            judgements = [judged(stage, v, m, start, gear) for v, m in done]
            found.state = watch(judgements, settings)
    return found


def table(plan: Sequence[Visit], found: Followed) -> list[dict[str, float]]:
    """Return true and followed size of the crack, visit by visit."""
    trace = found.state.traces.get("mesh.crack_1") if found.state else None
    if trace is None or trace.level is None:
        return []
    return [
        {
            "day": v.day,
            "speed": v.speed,
            "load": v.load,
            "true": v.crack,
            "alone": float(a),
            "std": float(s),
            "level": float(m),
            "level_std": float(d),
        }
        for v, a, s, m, d in zip(plan, trace.values, trace.stds, trace.level.mean, trace.level.std, strict=True)
    ]


def summary(found: Followed, rows: Sequence[Mapping[str, float]]) -> dict[str, object]:
    """Return what a reader wants to know of the year."""
    inside = [abs(r["level"] - r["true"]) <= 1.96 * r["level_std"] for r in rows]
    off = [abs(r["level"] - r["true"]) for r in rows]
    best = found.named[:3] if found.named else []
    return {
        "synthetic": True,
        "crack_begins_day": BEGINS,
        "detected_day": found.detected,
        "named": [{"gain": g, "gear": n, "tooth": t, "size": s} for g, n, t, s in best],
        "true_tooth": TOOTH,
        "largest_error_of_level": max(off, default=None),
        "visits_with_truth_in_95_percent": [sum(inside), len(inside)],
        "misfits": {
            n: list(t.values) for n, t in (found.state.traces.items() if found.state else ()) if t.kind == "misfit"
        },
        "visits": list(rows),
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Follow the stage and write the trend."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("out/gear-crack"))
    parser.add_argument("--visits", type=int, default=24)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(arguments)
    given.out.mkdir(parents=True, exist_ok=True)
    plan = visits(given.visits, given.seed)
    stage = GearStage.paper(imperfect=True)
    found = follow(stage, plan)
    told = summary(found, table(plan, found))
    (given.out / "trend.json").write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    for row in told["visits"]:
        print(
            f"day {row['day']:3.0f} {row['speed']:5.0f} r/min {row['load']:4.0f} N·m: crack {row['true']:.3f} true, "
            f"{row['alone']:+.3f} ± {row['std']:.3f} of this visit, {row['level']:+.3f} ± {row['level_std']:.3f} of all"
        )
    print({k: v for k, v in told.items() if k not in ("visits", "misfits")})


if __name__ == "__main__":
    main()
