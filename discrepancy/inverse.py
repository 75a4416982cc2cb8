"""The inverse residual: the machine is given its recorded motion, and the force that this needs is compared.

In a copy of the model every free motion whose position, angle or speed is measured becomes a prescribed one.  What acts
already (springs, friction, gravity, recorded forces) leaves a rest, the reaction of what prescribes the motion: zero
for the right model.  Motion and all recorded signals pass one and the same zero-phase low-pass, so that what is
compared has been treated alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.inverse_parts import GivenAngle, GivenPosition
from discrepancy.setup import Setup
from discrepancy.start_guess import follow, signal_bandwidth
from discrepancy.study_file import StudyError
from discrepancy.windows import crop
from estimation.experiment import Experiment
from estimation.record import Record, Signal
from estimation.signals import Preparation, edge_time, low_pass

if TYPE_CHECKING:
    from multibody.model import Model
    from multibody.system import System

__all__ = ["Inverse", "Motion", "derivatives", "inverse_setup"]

_UNITS = {"translation": ("m", "m/s", "m/s**2", "N"), "rotation": ("rad", "rad/s", "rad/s**2", "N*m")}


@dataclass(frozen=True)
class Motion:
    """A free motion of the machine that a sensor shows.

    Parameters
    ----------
    place : str
        Name of what moves.
    port : str
        Endpoint at which the motion is prescribed.
    domain : {"translation", "rotation"}
    output : str
        Measured output: ``offset + factor · (position or rate)``.
    order : int
        0 when the output shows the position, 1 when the rate.
    factor, offset : float
    states : tuple of str
        The position and rate states that become given.
    force : str
        Recorded force or torque that acts at the same place and nowhere else, or empty: it is then what the needed
        force is compared with, and no input any more.
    """

    place: str
    port: str
    domain: str
    output: str
    order: int
    factor: float
    offset: float
    states: tuple[str, str]
    force: str = ""

    @property
    def quantities(self) -> tuple[str, str, str]:
        """Names of position, rate and acceleration as model inputs."""
        words = ("position", "velocity") if self.domain == "translation" else ("angle", "speed")
        return (f"motion.{self.place}.{words[0]}", f"motion.{self.place}.{words[1]}", f"motion.{self.place}.acceleration")

    @property
    def compared(self) -> str:
        """Name of the output that is compared: the recorded force, else what is needed, to be compared with zero."""
        return self.force or self.needed

    @property
    def needed(self) -> str:
        """Name of the force or torque that the motion takes."""
        return f"needed.{self.place}.{'force' if self.domain == 'translation' else 'torque'}"


@dataclass(frozen=True, eq=False)
class Inverse:
    """A setup whose records give the motion.

    Parameters
    ----------
    setup : Setup
    motions : tuple of Motion
    bandwidth : float
        Of the low-pass that every signal has passed, Hz.
    told : str
        What was done, for the reason of the mode.
    """

    setup: Setup
    motions: tuple[Motion, ...]
    bandwidth: float
    told: str


def inverse_setup(setup: Setup, bandwidth: float | None = None) -> Inverse:
    """Return a setup in which the measured motion is given and the force that it needs is compared.

    Parameters
    ----------
    setup : Setup
    bandwidth : float, optional, Hz
        Of the smoothing; default: the study's low-pass, else where the motion disappears in its noise.

    Raises
    ------
    StudyError
        If no position, angle or speed of a free motion is measured.
    """
    first = setup.identify[0]
    model, cut = _cut_loops(setup.model, first.outputs)
    recorded = tuple(n for n in (*first.inputs, *cut) if n in model.inputs)
    outputs = tuple(n for n in first.outputs if n not in cut)
    system = model.build(outputs=outputs)
    motions = _motions(model, system, outputs, recorded, setup)
    if not motions:
        raise StudyError([
            "[study] residual = \"inverse\": none of the measured outputs "
            f"({', '.join(first.outputs)}) is the position, angle or speed of a free motion; measure one, or use "
            "\"simulation\" or \"prediction\""])
    inputs = tuple(n for n in recorded if n not in {m.force for m in motions})
    shown = _shows_motion(system, outputs, motions)
    prescribed = _prescribed(model, motions)
    if bandwidth is None:
        asked = first.preparation.low_pass_hz
        bandwidth = asked if asked is not None else max(
            signal_bandwidth(e.record.time, e.record.values(m.output)[:, 0]) for e in setup.identify for m in motions)
    compared = tuple(n for n in outputs if n not in shown)
    built = prescribed.build(outputs=(*(m.compared for m in motions), *compared))
    known = set(built.parameter_names)
    whole = setup.model.build(outputs=first.outputs)

    def given(e: Experiment) -> Experiment:
        return _experiment(crop(e), motions, inputs, compared, built, bandwidth, whole)

    identify, validate = tuple(map(given, setup.identify)), tuple(map(given, setup.validate))
    excluded = (*setup.exclude, "sensor_*@needed.*", "input_*@motion.*")
    noise = {n: v for n, v in setup.noise.items() if n in compared}
    changed = replace(
        setup, model=prescribed, identify=identify, validate=validate, exclude=excluded, noise=noise,
        uncertain=tuple(q for q in setup.uncertain if q.name in known))
    changed = replace(changed, noise={**noise, **_floors(changed, built, motions)})
    names = " and ".join(m.output for m in motions)
    return Inverse(
        changed, motions, bandwidth,
        f"the motion is given by {names}, low-passed at {bandwidth:.3g} Hz, and the force or torque that it needs is compared")


def derivatives(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return first and second derivative of a smooth, evenly sampled signal by five-point differences.

    Parameters
    ----------
    time, values : ndarray, shape (n,)
        Already low-passed to a tenth of the sampling rate at most, where the formulas are right within 1.3 %, and
        within 0.1 % at a twentieth.

    Notes
    -----
    Differences of the low-passed signal, and not a smoothing differentiator: position, rate, acceleration and the
    recorded forces then have passed the same filter, and nothing is left over that looks like a missing inertia.
    """
    h = float(time[-1] - time[0]) / (len(time) - 1)
    padded = np.concatenate([_beyond(values[:8])[::-1], values, _beyond(values[::-1][:8])])
    a, b, c, d, e = (padded[k : len(padded) - 4 + k] for k in range(5))
    return (a - 8.0 * b + 8.0 * d - e) / (12.0 * h), (-a + 16.0 * b - 30.0 * c + 16.0 * d - e) / (12.0 * h * h)


def _beyond(first: np.ndarray) -> np.ndarray:
    """Continue a signal two samples before its first by the cubic through its first four."""
    a, b, c, d = first[:4]
    one = 4.0 * a - 6.0 * b + 4.0 * c - d
    return np.array([one, 4.0 * one - 6.0 * a + 4.0 * b - c])


# ---------------------------------------------------------------- the model


def _cut_loops(model: Model, outputs: Sequence[str]) -> tuple[Model, tuple[str, ...]]:
    """Return a copy in which measured signals of controllers are inputs, and what then drives nothing is left out."""
    from multibody.declare import Output, Port

    other, cut = model.copy(), []
    for name in outputs:
        source = model.outputs.get(name, name)
        found = model.find(source)
        if found is None or not isinstance(found[1].declarations.get(found[2]), Output) or found[1].of_kind(Port):
            continue
        fed = [e for ends in other.connections if source in ends for e in ends if e != source]
        if not fed:
            continue
        graph = other._graph
        graph.connections = [ends for ends in graph.connections if source not in ends]
        graph.outputs.pop(name, None)
        other.input(name, *fed)
        cut.append(name)
    if cut:
        _prune(other)
    return other, tuple(cut)


def _prune(model: Model) -> None:
    """Take out signal parts whose outputs feed nothing any more, and what only fed them."""
    from multibody.declare import Port

    graph = model._graph
    while True:
        idle = [
            n for n, c in graph.components.items()
            if not c.of_kind(Port) and not any(_owner(model, e) == n for e in graph.outputs.values())
            and not any(_owner(model, ends[0]) == n or _outputs_of(model, ends, n) for ends in graph.connections)]
        if not idle:
            return
        for name in idle:
            kept = []
            for ends in graph.connections:
                rest = tuple(e for e in ends if _owner(model, e) != name)
                if len(rest) > 1:
                    kept.append(rest)
            for entry in graph.inputs.values():
                entry.targets = [t for t in entry.targets if _owner(model, t) != name]
            graph.connections = kept
            graph.inputs = {k: v for k, v in graph.inputs.items() if v.targets}
            del graph.components[name]


def _owner(model: Model, endpoint: str) -> str:
    found = model.find(endpoint)
    return found[0] if found is not None else ""


def _outputs_of(model: Model, ends: Sequence[str], name: str) -> bool:
    from multibody.declare import Output

    for end in ends:
        found = model.find(end)
        if found is not None and found[0] == name and isinstance(found[1].declarations.get(found[2]), Output):
            return True
    return False


def _motions(
    model: Model, system: System, outputs: Sequence[str], recorded: Sequence[str], setup: Setup
) -> list[Motion]:
    """Return the free motions that an output shows by itself, one output for each, positions before rates."""
    labels = {}
    for place in model.places():
        if place.second is None and place.first.prescriber is None:
            port = place.first.label
            if port.coordinate:
                names = [n for n, _ in port.component.coordinate_states(port.coordinate)]  # type: ignore[attr-defined]
            else:
                words = ("position", "velocity") if place.domain == "translation" else ("angle", "speed")
                names = [w if f"{port.owner}.{w}" in system.state_names else f"{port.port_name}_{w}" for w in words]
            states = tuple(f"{port.owner}.{n}" for n in names)
            if all(s in system.state_names for s in states):
                labels[states] = (place.name, port.name, place.domain)
    values = _affine(system, outputs, setup)
    found: dict[tuple[str, ...], Motion] = {}
    for order in (0, 1):
        for states, (place, port, domain) in labels.items():
            if states in found:
                continue
            for output, (state, factor, offset) in values.items():
                if state == states[order]:
                    force = _force_at(model, port, domain, recorded)
                    found[states] = Motion(place, port, domain, output, order, factor, offset, states, force)  # type: ignore[arg-type]
                    break
    return list(found.values())


def _affine(system: System, outputs: Sequence[str], setup: Setup) -> dict[str, tuple[str, float, float]]:
    """Return the outputs that are ``offset + factor · state`` for one state, by name."""
    p = system.parameter_vector({q.name: q.value for q in setup.uncertain if q.name in system.parameter_names})
    points = [system.start + shift * np.arange(1, system.start.size + 1) for shift in (0.0, 0.0137, -0.0291)]
    slopes = [system.jacobian("x", 0.0, x, None, p, of="outputs") for x in points]
    by_input = [system.jacobian("u", 0.0, x, None, p, of="outputs") for x in points]
    found = {}
    for name in outputs:
        c = system.index("output", name)
        row = slopes[0][c]
        used = np.flatnonzero(row)
        same = all(np.allclose(s[c], row, rtol=1e-9, atol=0.0) for s in slopes)
        if used.size == 1 and same and not any(np.any(b[c]) for b in by_input):
            k = int(used[0])
            y = system.outputs_at(0.0, points[0], None, p)[c]
            found[name] = (system.state_names[k], float(row[k]), float(y - row[k] * points[0][k]))
    return found


def _shows_motion(system: System, outputs: Sequence[str], motions: Sequence[Motion]) -> set[str]:
    """Return the outputs that tell nothing but the motion that is given now."""
    given = np.array([system.index("state", s) for m in motions for s in m.states])
    x = system.start + 0.0137
    slopes = system.jacobian("x", 0.0, x, of="outputs")
    by_input = system.jacobian("u", 0.0, x, of="outputs")
    units = {"m", "rad", "m/s", "rad/s"}
    found = {m.output for m in motions}
    for name in outputs:
        c = system.index("output", name)
        others = np.delete(slopes[c], given)
        if system.unit(name) in units and not np.any(others) and not np.any(by_input[c]):
            found.add(name)
    return found


def _force_at(model: Model, port: str, domain: str, recorded: Sequence[str]) -> str:
    """Return the recorded input that acts as a force at a port's node and nowhere else, or an empty text."""
    from multibody.library import ForceSource, TorqueSource

    unit = _UNITS[domain][3]
    node = next(p.first for p in model.places() if p.second is None and p.first.label.name == port)
    owners = {p.owner: p.component for p in node.ports}
    for name in recorded:
        targets = [model.find(t) for t in model.inputs[name].targets]
        if targets and all(
            f is not None and f[0] in owners and getattr(f[1].declarations[f[2]], "unit", "") == unit
            and isinstance(f[1], ForceSource | TorqueSource) for f in targets
        ) and len(targets) == 1:
            return name
    return ""


def _prescribed(model: Model, motions: Sequence[Motion]) -> Model:
    other = model.copy()
    for m in motions:
        part = f"needed.{m.place}"
        cls = GivenPosition if m.domain == "translation" else GivenAngle
        other.add(part, cls())
        other.connect(f"{part}.flange", m.port)
        for name in m.quantities:
            other.input(name, f"{part}.{name.rpartition('.')[2]}")
        if m.force:
            entry = other._graph.inputs.pop(m.force)
            other.input(f"idle.{m.force}", *entry.targets, default=0.0)
            other.output(m.force, m.needed)
    states = {s for m in motions for s in m.states}
    other._graph.outputs = {n: s for n, s in other._graph.outputs.items() if s not in states}
    return other


# ---------------------------------------------------------------- the records


def _experiment(
    experiment: Experiment, motions: Sequence[Motion], inputs: Sequence[str], compared: Sequence[str], system: System,
    bandwidth: float, whole: System,
) -> Experiment:
    """Return an experiment whose record gives the motion; other states start where the whole machine was then."""
    record = experiment.record
    time = np.array(record.time)
    nyquist = 0.5 * record.rate
    cutoff = min(bandwidth, 0.45 * nyquist)
    edge = int(np.ceil(edge_time(cutoff) * record.rate))
    if time.size < 4 * edge + 40:
        raise StudyError([
            f"{record.name}: {time.size} samples are too few to differentiate a motion at {cutoff:.3g} Hz ({edge} samples "
            "are left out at each end): record longer, or use \"prediction\""])
    inside = slice(edge, time.size - edge)
    inputs = tuple(n for n in inputs if n in record.signals)
    signals: dict[str, Signal] = {}
    for name in (*inputs, *compared):
        given = record.signals[name]
        signals[name] = replace(given, values=low_pass(time, given.values, cutoff)[inside])
    for m in motions:
        units = _UNITS[m.domain]
        smooth = (low_pass(time, record.signals[m.output].values, cutoff) - m.offset) / m.factor
        rate, second = derivatives(time, smooth)
        if m.order == 1:
            position = np.concatenate([[0.0], np.cumsum(0.5 * (smooth[1:] + smooth[:-1]) * np.diff(time))])
            start = experiment.start.get(m.states[0], 0.0)
            smooth, rate, second = position + (start if isinstance(start, float | int) else 0.0), smooth, rate
        for name, values, unit in zip(m.quantities, (smooth, rate, second), units, strict=False):
            signals[name] = Signal(values[inside], unit, record.signals[m.output].column, unit)
        if m.force:
            given = record.signals[m.force]
            signals[m.force] = replace(given, values=low_pass(time, given.values, cutoff)[inside])
        else:
            signals[m.needed] = Signal(np.zeros(time.size)[inside], units[3], "", units[3])
    log = (*record.log, f"zero-phase low-pass at {cutoff:.4g} Hz, motion differentiated, {edge} samples left out at each end")
    left = Record(record.name, record.path, time[inside], signals, log, record.warnings)
    factor = max(1, int(record.rate / (5.0 * cutoff)))
    factor = max(1, min(factor, left.time.size // 200))
    given = experiment.preparation
    factor = max(factor, given.decimate if given.decimate * 200 <= left.time.size else 1)
    free = tuple(n for n in system.state_names if not n.startswith("energy."))
    start: dict[str, float] = {}
    if free:
        x = follow(experiment, whole, whole.p).at(edge)
        start = {n: float(x[whole.index("state", n)]) for n in free if n in whole.state_names}
    return replace(
        experiment, record=left, inputs=(*inputs, *(q for m in motions for q in m.quantities)),
        outputs=(*(m.compared for m in motions), *compared), preparation=Preparation(decimate=factor), start=start,
        free=free, held=(), offsets=tuple(o for o in experiment.offsets if o in compared), _cache={})


def _floors(setup: Setup, system: System, motions: Sequence[Motion]) -> dict[str, float]:
    """Return the noise of what is compared: the model's force carries the noise of the differentiated motion."""
    from estimation.metrics import noise_floor

    p = system.parameter_vector({q.name: q.value for q in setup.uncertain})
    found: dict[str, list[float]] = {}
    for e in setup.identify:
        rest = e.measured - e.simulate(system, p)
        for c, m in enumerate(motions):
            found.setdefault(m.compared, []).append(noise_floor(rest[:, c]).std)
    return {n: float(np.median(v)) for n, v in found.items()}
