"""One case: a machine, what is hidden in it, how visible that is, and a seed; drawn, and written as a study."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from discrepancy.validation.machines.disturbances import Disturbance, drawn_disturbance, modes
from discrepancy.validation.machines.grading import Information, information, repeated, stacked, white_noise
from discrepancy.validation.machines.machine import Effect, Machine
from discrepancy.validation.machines.simulate import simulate

__all__ = ["FINAL", "NATS", "WHAT", "Case", "CaseError", "Drawn", "draw", "write"]

Array = NDArray[np.float64]

#: First word of the seeds that fixes may look at.  NumPy's seed sequences with another first word are other streams.
DEVELOPMENT = 27
#: First word of the seeds that are run once, after the last change: another number, so other streams.  A number is used
#: up by its run, after which faults are mended that it showed; 72 to 95 are.
FINAL = 96
NATS = (10, 30, 100, 1000)  # from hardly visible (a Bayes factor of exp 10) to plain
WHAT = ("nothing", "single", "pair", "masking", "outside")
FARTHEST = 2.5  # deviations of a true parameter from the stated one: 1 in 80 of honest statements is farther off
SMALL = 0.3  # nats of a difference that does not matter: no method can see it
MASKS = 0.3  # correlation at which two effects hide a tenth of each other's gain; weaker pairs are plain pairs
TIED = 0.97  # above it the two are one effect to these records, and a pair of them cannot be graded
COMPARED = 30.0  # nats at which the directions of effects are compared: nearly linear still
STEPS = 9  # strengths tried in one run of the machine, from a thousandth of the usual one to a hundred times
CLOSE = 0.1  # relative error of the nats that are reached
ROUNDS = 12  # of closing in on them, every second of which halves the interval: two of the steps become 1/64 of one


class CaseError(ValueError):
    """A case cannot be made, and why."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """What a case is made from.

    Parameters
    ----------
    machine : str
    what : str
        One of `WHAT`, or the name of an effect of the machine.
    nats : float
    seed : int
    final : bool
        Of the seeds that are run once.
    """

    machine: str
    what: str
    nats: float
    seed: int
    final: bool = False

    @property
    def name(self) -> str:
        """Name of the case's folder."""
        nats = "" if self.what == "nothing" else f"-{self.nats:g}"
        return f"{self.machine}-{self.what}{nats}-{'final' if self.final else 'dev'}{self.seed}"

    def generator(self, part: int) -> np.random.Generator:
        """Return the random numbers of one part of the case."""
        words = [zlib.crc32(text.encode()) for text in (self.machine, self.what)]
        return np.random.default_rng(
            [FINAL if self.final else DEVELOPMENT, *words, round(10 * self.nats), self.seed, part]
        )


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A case with all that was drawn for it.

    Parameters
    ----------
    case : Case
    machine : Machine
    category : {"none", "single", "pair", "masking", "outside"}
    hidden : mapping of str to float
        Strength of each hidden effect.
    values : mapping of str to float or ndarray, shape (records,)
        True quantities of the equations.
    drives : mapping of str to ndarray, shape (rows, records)
    disturbance : Disturbance
    nats : mapping of str to float
        Gain reached by each hidden effect: alone, or of a pair given the other.
    correlation : float
        Of the two effects of a pair, after recalibration.
    small : mapping of str to float
        Strength of a difference that does not matter.
    recorded : mapping of str to ndarray, shape (rows, records)
        What the sensors read.
    floor : mapping of str to float
        Root mean square by channel of what the true model leaves of the held-out records.
    """

    case: Case
    machine: Machine
    category: str
    hidden: Mapping[str, float]
    values: Mapping[str, Any]
    drives: Mapping[str, Array]
    disturbance: Disturbance
    nats: Mapping[str, float]
    correlation: float = 0.0
    small: Mapping[str, float] = field(default_factory=dict)
    recorded: Mapping[str, Array]
    floor: Mapping[str, float]


class _Graded:
    """The identification records of a case without effects, and how far each effect moves them."""

    def __init__(self, case: Case, machine: Machine, values: dict[str, Any], drives: dict[str, Array]) -> None:
        self.machine, self.count = machine, machine.identify
        self.values = {k: v[: self.count] if np.ndim(v) else v for k, v in values.items()}
        self.drives = {k: v[:, : self.count] for k, v in drives.items()}
        self.quiet = stacked(machine, simulate(machine, self.values, self.drives))
        self.disturbance = drawn_disturbance(case.generator(1), dict(machine.places), machine.dt * machine.rows)
        self.weight: Information = information(machine, self.values, self.drives, self.disturbance, case.generator(2))

    def differences(self, changes: Sequence[Mapping[str, float]]) -> Array:
        """Return what each set of changed quantities does to the records, an array (samples, changes)."""
        names = {name for change in changes for name in change}
        n = len(changes)
        values: dict[str, Any] = {k: np.tile(np.broadcast_to(v, self.count), n) for k, v in self.values.items()}
        for name in names:
            own = self.values.get(name, 0.0)
            each = [np.broadcast_to(change.get(name, own), self.count) for change in changes]
            values[name] = np.concatenate(each).astype(float)
        runs = stacked(self.machine, simulate(self.machine, values, repeated(self.drives, n)))
        runs = runs.reshape(*runs.shape[:2], n, self.count) - self.quiet[:, :, None]
        return np.moveaxis(runs, 2, -1).reshape(-1, n)

    def strength(self, effect: Effect, sign: float, shape: Mapping[str, float], nats: float) -> tuple[float, float]:
        """Return the strength at which an effect has a gain, and the gain reached."""
        tried = sign * effect.size * np.geomspace(1e-3, 1e2, STEPS)
        gain = self._gains(effect, tried, shape)
        for k in range(ROUNDS):
            known = gain > 0.0
            if not known.any() or gain[known].max() < nats:
                break
            sizes, most = np.log(np.abs(tried[known])), np.log(np.maximum.accumulate(gain[known]))
            above = int(np.searchsorted(most, np.log(nats)))
            between = np.interp(np.log(nats), most, sizes)
            if not above:  # the gain of a small effect is in the square of its strength
                between = sizes[0] - 0.5 * (most[0] - np.log(nats))
            elif k % 2:  # where the gain is far from a power of the strength, halving comes nearer
                between = 0.5 * (sizes[above - 1] + sizes[above])
            value = sign * float(np.exp(between))
            if value in tried:
                break
            order = np.argsort(np.abs([*tried, value]))
            gain = np.append(gain, self._gains(effect, np.array([value]), shape))[order]
            tried = np.append(tried, value)[order]
            if abs(gain[tried == value][0] / nats - 1.0) < CLOSE:
                return value, float(gain[tried == value][0])
        raise CaseError(
            f"{self.machine.name}: '{effect.name}' does not reach {nats:g} nats; the largest gain is {gain.max():.3g}, "
            f"at {tried[gain.argmax()]:.3g}"
        )

    def _gains(self, effect: Effect, strengths: Array, shape: Mapping[str, float]) -> Array:
        moved = []
        for value in strengths:  # one after the other: a strength that breaks the machine must not lose the others
            moved.append({effect.strength: float(value), **shape})
        with np.errstate(all="ignore"):  # the strongest ones may leave the finite numbers, and are then left out
            try:
                d = self.differences(moved)
            except FloatingPointError:
                d = np.column_stack([self._alone(change) for change in moved])
        return np.array([self.weight.nats(column) if np.isfinite(column).all() else 0.0 for column in d.T])

    def _alone(self, change: Mapping[str, float]) -> Array:
        try:
            return self.differences([change])[:, 0]
        except FloatingPointError:
            return np.full(self.quiet.size, np.nan)


def _true_values(case: Case, machine: Machine) -> dict[str, Any]:
    """Draw the true parameters, one of them far off, and the start values of each record."""
    rng = case.generator(3)
    off = np.clip(rng.standard_normal(len(machine.parameters)), -FARTHEST, FARTHEST)
    off[rng.integers(off.size)] = rng.choice([-1.0, 1.0]) * rng.uniform(0.6, 1.0) * FARTHEST
    values: dict[str, Any] = {}
    for parameter, z in zip(machine.parameters, off, strict=True):
        value = parameter.stated + z * parameter.std
        values[parameter.name] = max(value, 0.1 * parameter.stated) if parameter.positive else value
    records = machine.identify + machine.validate
    for begin in machine.starts:
        values[begin.name] = begin.std * rng.standard_normal(records)
    return values


def _drives(case: Case, machine: Machine) -> dict[str, Array]:
    """Draw the drives of all records, rounded as the file holds them."""
    rng = case.generator(4)
    records = [machine.excite(rng, machine.times) for _ in range(machine.identify + machine.validate)]
    columns = {d.name: np.column_stack([r[d.name] for r in records]) for d in machine.drives}
    return {name: np.asarray(np.round(column, 9), dtype=np.float64) for name, column in columns.items()}


def draw(case: Case, machine: Machine) -> Drawn:
    """Draw a case: true values, drives, a disturbance, and the strengths that give the nats.

    Raises
    ------
    CaseError
        If an effect does not reach the nats, or the machine has no two effects that mask each other.
    """
    values, drives = _true_values(case, machine), _drives(case, machine)
    graded = _Graded(case, machine, values, drives)
    rng = case.generator(5)
    category, effects, correlation = _chosen(case, machine, rng)
    shapes = {e.name: {k: float(rng.uniform(*v)) for k, v in e.shape.items()} for e in machine.effects}
    signs = {e.name: float(rng.choice([-1.0, 1.0])) if e.signed else 1.0 for e in machine.effects}
    hidden: dict[str, float] = {}
    nats: dict[str, float] = {}
    if category in ("pair", "masking"):
        effects, signs, correlation = _pair(category, effects, graded, shapes, signs, rng)
    for effect in effects:  # given the other one, a pair's gain is smaller by the square of their correlation
        wanted = case.nats / (1.0 - correlation**2)
        hidden[effect.name], gain = graded.strength(effect, signs[effect.name], shapes[effect.name], wanted)
        nats[effect.name] = gain * (1.0 - correlation**2)
    small: dict[str, float] = {}
    if category == "none" and case.seed % 2:
        other = machine.effects[int(rng.integers(len(machine.effects)))]
        small[other.name] = graded.strength(other, signs[other.name], shapes[other.name], SMALL)[0]
    true = dict(values)
    for name, strength in {**hidden, **small}.items():
        true |= {machine.effect(name).strength: strength, **shapes[name]}
    recorded, floor = _recorded(case, machine, true, drives, graded.disturbance)
    return Drawn(
        case=case,
        machine=machine,
        category=category,
        hidden=hidden,
        values=true,
        drives=drives,
        disturbance=graded.disturbance,
        nats=nats,
        correlation=correlation,
        small=small,
        recorded=recorded,
        floor=floor,
    )


def _chosen(case: Case, machine: Machine, rng: np.random.Generator) -> tuple[str, list[Effect], float]:
    """Return the category of a case and the effects to hide, or to choose from."""
    inside = [e for e in machine.effects if not e.outside]
    if case.what == "nothing":
        return "none", [], 0.0
    if case.what in ("pair", "masking"):
        return case.what, inside, 0.0
    if case.what == "single":
        return "single", [inside[int(rng.integers(len(inside)))]], 0.0
    if case.what == "outside":
        foreign = [e for e in machine.effects if e.outside]
        return "outside", [foreign[int(rng.integers(len(foreign)))]], 0.0
    effect = machine.effect(case.what)
    return "outside" if effect.outside else "single", [effect], 0.0


def _pair(
    category: str,
    effects: Sequence[Effect],
    graded: _Graded,
    shapes: Mapping[str, Mapping[str, float]],
    signs: Mapping[str, float],
    rng: np.random.Generator,
) -> tuple[list[Effect], dict[str, float], float]:
    """Choose two effects: any two, or two that oppose each other; return them, their signs and their correlation."""
    chosen, moved = list(effects), []
    for effect in effects:
        strength, _ = graded.strength(effect, signs[effect.name], shapes[effect.name], COMPARED)
        moved.append(graded.differences([{effect.strength: strength, **shapes[effect.name]}])[:, 0])
    gram = graded.weight.inner(np.column_stack(moved), np.column_stack(moved))
    size = np.sqrt(np.diag(gram))
    rho = gram / np.outer(size, size)
    pairs = [(i, j) for i in range(len(chosen)) for j in range(i) if abs(rho[i, j]) < TIED]
    turned = dict(signs)
    if category == "masking":

        def opposed(pair: tuple[int, int]) -> float:
            i, j = pair
            free = chosen[i].signed or chosen[j].signed
            return -abs(rho[pair]) if free else float(rho[pair])

        pairs = sorted((pair for pair in pairs if opposed(pair) < -MASKS), key=opposed)
        if not pairs:
            raise CaseError(f"{graded.machine.name}: no two effects mask each other (correlation below {-MASKS:g})")
        i, j = pairs[int(rng.integers(min(2, len(pairs))))]
        if rho[i, j] > 0.0:
            turned[chosen[i if chosen[i].signed else j].name] *= -1.0
        return [chosen[i], chosen[j]], turned, -abs(float(rho[i, j]))
    if not pairs:
        raise CaseError(f"{graded.machine.name}: no two effects can be distinguished")
    i, j = pairs[int(rng.integers(len(pairs)))]
    return [chosen[i], chosen[j]], turned, float(rho[i, j])


def _recorded(
    case: Case, machine: Machine, values: Mapping[str, Any], drives: Mapping[str, Array], disturbance: Disturbance
) -> tuple[dict[str, Array], dict[str, float]]:
    """Return what the sensors read, and what the true model leaves of the held-out records, by channel."""
    rng, records = case.generator(6), machine.identify + machine.validate
    forces = None
    if disturbance.rms:
        waves = modes(disturbance, machine.times, every=True)
        forces = {disturbance.place: waves.T @ rng.standard_normal((len(waves), records))}
    noise = white_noise(machine, rng, machine.rows, records)
    recorded = simulate(machine, values, drives, forces, noise)
    true = simulate(machine, values, drives)
    late = slice(machine.identify, None)
    floor = {n: float(np.sqrt(((recorded[n] - true[n])[:, late] ** 2).mean())) for n in recorded}
    return recorded, floor


def write(drawn: Drawn, folder: Path) -> Path:
    """Write a case as a user would have it, and its truth; return the study's file.

    ``machine.md``, ``model.py``, ``study.toml``, ``records/*.csv`` and ``truth.json``.
    """
    machine = drawn.machine
    (folder / "records").mkdir(parents=True, exist_ok=True)
    (folder / "machine.md").write_text(f"# {machine.name}\n{machine.about}")
    (folder / "model.py").write_text(machine.model.lstrip("\n"))
    names = [f"identify_{k + 1:02d}" for k in range(machine.identify)]
    names += [f"validate_{k + 1:02d}" for k in range(machine.validate)]
    for k, name in enumerate(names):
        columns = {"time_s": machine.times}
        columns |= {d.column: drawn.drives[d.name][:, k] * d.scale for d in machine.drives}
        columns |= {c.column: drawn.recorded[c.name][:, k] * c.scale for c in machine.channels}
        table = np.column_stack(list(columns.values()))
        path = folder / "records" / f"{name}.csv"
        np.savetxt(path, table, fmt="%.10g", delimiter=",", header=",".join(columns), comments="")
    (folder / "study.toml").write_text(_study(machine))
    (folder / "truth.json").write_text(json.dumps(_truth(drawn), indent=1) + "\n")
    return folder / "study.toml"


def _study(machine: Machine) -> str:
    lines = ["[model]", 'build = "model.py:build"', "", "[uncertain]"]
    for p in machine.parameters:
        least = ", min = 0.0" if p.positive else ""
        lines.append(f'"{p.path}" = {{ value = {p.stated:.10g}, std = {p.std:.6g}{least} }}')
    lines += ["", "[inputs]"]
    for d in machine.drives:
        more = f', unit = "{d.unit}"' * bool(d.unit) + ', interpolation = "hold"' * d.hold
        lines.append(f'"{d.input}" = {{ column = "{d.column}"{more} }}')
    lines += ["", "[outputs]"]
    for c in machine.channels:
        unit = f', unit = "{c.unit}"' * bool(c.unit)
        lines.append(f'"{c.output}" = {{ column = "{c.column}", noise = {c.deviation:.4g}{unit} }}')
    lines += ["", "[records]", 'time = "time_s"', 'identify = ["records/identify_*.csv"]']
    lines += ['validate = ["records/validate_*.csv"]']
    if machine.starts:
        states = ", ".join(f'"{s.state}"' for s in machine.starts)
        lines += ["", "[initial]", f"free = [{states}]"]
    return "\n".join(lines) + "\n"


def _truth(drawn: Drawn) -> dict[str, Any]:
    machine = drawn.machine

    def described(name: str, strength: float) -> dict[str, Any]:
        effect = machine.effect(name)
        return {"name": name, "accept": list(effect.accept), "what": effect.what, "strength": strength}

    return {
        "case": asdict(drawn.case),
        "category": drawn.category,
        "effects": [{**described(name, s), "nats": drawn.nats[name]} for name, s in drawn.hidden.items()],
        "correlation": drawn.correlation,
        "small_difference": [described(name, s) for name, s in drawn.small.items()],
        "disturbance": asdict(drawn.disturbance),
        "true": {p.name: float(drawn.values[p.name]) for p in machine.parameters},
        "deviations_off": {p.name: (drawn.values[p.name] - p.stated) / p.std for p in machine.parameters},
        "achievable": {c.output: drawn.floor[c.name] for c in machine.channels},
    }
