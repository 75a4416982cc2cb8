"""Functions of motion and inputs of which a force may be made that no law of the catalogue describes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from discrepancy.evidence.likelihood import noise_floor, sources
from discrepancy.innovations.linear_record import LinearRecord
from discrepancy.sensitivities.linearised_problem import LinearisedProblem
from multibody.base.parallel import parallel_map
from multibody.solvers.kernels.perturbations import propagate

__all__ = ["FeatureBlock", "feature_blocks"]

#: Speed over the usual one below which the direction of motion turns over: friction laws bend there.
TURNING = 0.1
#: Memories of what an effect may remember, in durations of a record: creep, heat, wear-in, the time at rest.
MEMORIES = (0.003, 0.03, 0.3)
#: Inputs and outputs each that the features are made of: of more the products would be too many.
MOST_SIGNALS = 3

Terms = dict[str, list[np.ndarray]]
Response = Callable[[int, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False, kw_only=True)
class FeatureBlock:
    """What the features at one place change in the records.

    Parameters
    ----------
    where : str
        The connection on which they act as forces, or the input or output that they are added to.
    columns : list of ndarray, shape (n, n_c, m)
        For each record, each scaled to move the outputs by their noise once in all.
    groups : mapping of str to ndarray of int
        Columns of each group, by what its features depend on.
    """

    where: str
    columns: list[np.ndarray]
    groups: Mapping[str, np.ndarray]


def feature_blocks(linearised: LinearisedProblem, records: Sequence[LinearRecord]) -> Iterator[FeatureBlock]:
    """Yield the features of every connection, input and output."""
    signals = _Signals.of(linearised, records)
    places, outputs = linearised.system.places, linearised.residual().channels
    inputs = signals.inputs
    noise = noise_floor(linearised)
    driving = [*inputs[:MOST_SIGNALS], *outputs[:MOST_SIGNALS]]

    def block(where: str, terms: Callable[[int], Terms], response: Response) -> FeatureBlock:
        every = parallel_map(terms, range(len(records)))
        names = [name for name, own in every[0].items() for _ in own]
        stacked = [np.stack([c for own in t.values() for c in own], axis=1) for t in every]
        columns = [response(i, values) for i, values in enumerate(stacked)]
        squares = sum(np.sum((b / noise[:, None]) ** 2, axis=(0, 1)) for b in columns)
        size = np.sqrt(np.asarray(squares))
        shown = np.isfinite(size) & (size > 0.0)
        groups = {n: np.flatnonzero(shown & (np.array(names) == n)) for n in dict.fromkeys(names)}
        scaled = [b / np.where(shown, size, 1.0) for b in columns]
        return FeatureBlock(where=where, columns=scaled, groups={n: g for n, g in groups.items() if g.size})

    def driven(source: int) -> Response:
        def response(i: int, values: np.ndarray) -> np.ndarray:
            r = records[i]
            n, m = r.phi.shape[1], values.shape[1]
            out, room = np.empty((*r.c.shape[:2], m)), np.empty((2, n, m))
            matrices = (r.phi, r.gamma0, r.gamma1, r.c, r.d)
            propagate(*matrices, np.full(m, source), np.ascontiguousarray(values), room, out)
            return out[r.observed]

        return response

    def added(channel: int) -> Response:
        def response(i: int, values: np.ndarray) -> np.ndarray:
            seen = values[records[i].observed]
            out = np.zeros((seen.shape[0], len(outputs), seen.shape[1]))
            out[:, channel] = seen
            return out

        return response

    def without_motion(i: int) -> Terms:
        return signals.without_motion(i, driving)

    for j, place in enumerate(places):
        yield block(place.name, partial(signals.at_place, place=j, driving=driving), driven(j))
    for j, name in enumerate(inputs):
        yield block(name, without_motion, driven(len(places) + j))
    for c, name in enumerate(outputs):
        yield block(name, without_motion, added(c))


@dataclass(frozen=True, eq=False, kw_only=True)
class _Signals:
    """Signals along every record, scaled over all records."""

    linearised: LinearisedProblem
    inputs: list[str]
    times: list[np.ndarray]
    values: list[dict[str, np.ndarray]]
    scaled: list[dict[str, np.ndarray]]

    @classmethod
    def of(cls, linearised: LinearisedProblem, records: Sequence[LinearRecord]) -> _Signals:
        """Return the signals on the time grids of linearised records."""
        inputs = [n for n in sources(linearised) if not n.startswith("probe.")]
        system, outputs = linearised.system, linearised.residual().channels
        motion = [[f"place.{p.name}.{n}" for n, _ in p.motion_names()][:2] for p in system.places]
        values = []
        for i, record in enumerate(records):
            experiment, run = linearised.experiments[i], linearised.nominal_outputs(i)
            own = np.asarray(experiment.record.time)
            raw = {n: run[n] for n in [*(n for pair in motion for n in pair), *outputs] if n in run}
            raw |= {n: experiment.record.values(n)[:, 0] for n in inputs}
            values.append({n: np.interp(record.time, own, v) for n, v in raw.items()})
        positions = {pair[0] for pair in motion}
        scale: dict[str, tuple[float, float]] = {}
        for n in values[0]:
            pooled = np.concatenate([v[n] for v in values])
            centre = float(np.mean(pooled)) if n in positions else 0.0
            scale[n] = centre, max(float(np.sqrt(np.mean((pooled - centre) ** 2))), 1e-300)
        scaled = [{n: (x - scale[n][0]) / scale[n][1] for n, x in v.items()} for v in values]
        return cls(linearised=linearised, inputs=inputs, times=[r.time for r in records], values=values, scaled=scaled)

    def _remembered(self, i: int, signal: np.ndarray) -> list[np.ndarray]:
        """Return a signal low-passed with each of the memories, from its first value."""
        from scipy.signal import lfilter

        time = self.times[i]
        step = float(np.median(np.diff(time)))
        longest = float(time[-1] - time[0])
        out = []
        for memory in MEMORIES:
            rho = np.exp(-step / max(memory * longest, step))
            out.append(lfilter([1.0 - rho], [1.0, -rho], signal, zi=[rho * signal[0]])[0])
        return out

    def at_place(self, i: int, place: int, driving: Sequence[str]) -> Terms:
        """Return the features of a force at a connection, by what it depends on."""
        s, system = self.scaled[i], self.linearised.system
        names = [[f"place.{p.name}.{n}" for n, _ in p.motion_names()][:2] for p in system.places]
        x, v = (s[n] for n in names[place])
        sense, quick = np.tanh(v / TURNING), np.abs(v)
        resting, moving = self._remembered(i, np.exp(-((v / TURNING) ** 2))), self._remembered(i, quick)
        terms: Terms = {
            "position": [x, x**2, x**3],
            "speed": [sense, v, v * quick, sense * np.log1p(quick / TURNING)],
            "position and speed": [x * v, x**2 * v, x * sense, x**2 * sense],
            "earlier positions": self._remembered(i, x),
            "speed and the time at rest": [m * sense for m in resting],
            "speed and earlier motion": [m * f for m in moving for f in (sense, v)],
            "position and earlier motion": [m * x for m in moving],
        }
        for k in driving:
            u = s[k]
            terms |= {
                k: [u, u**2, u * np.abs(u), u**3],
                f"{k} and position": [u * x, u * x**2, u**2 * x],
                f"{k} and speed": [u * v, u * sense, np.abs(u) * v, np.abs(u) * sense],
                f"earlier {k}": self._remembered(i, u),
            }
        for other, pair in enumerate(names):
            if system.places[other].domain == "rotation":  # what turns repeats once or twice a turn
                angle = self.values[i][pair[0]]
                turn = [f(k * angle) for k in (1, 2) for f in (np.sin, np.cos)]
                terms[f"angle of {system.places[other].name} and position"] = [t * x for t in turn]
                terms[f"angle of {system.places[other].name} and speed"] = [t * sense for t in turn]
            if other != place:
                terms[f"position and position of {system.places[other].name}"] = [x * s[pair[0]], x * s[pair[0]] ** 2]
        return terms

    def without_motion(self, i: int, driving: Sequence[str]) -> Terms:
        """Return the features of what is added to an input or an output, by what it depends on."""
        s = self.scaled[i]
        terms: Terms = {}
        for k in driving:
            u, earlier = s[k], self._remembered(i, s[k])
            terms[k] = [u, u**2, u * np.abs(u), u**3]
            terms[f"{k} and its past"] = [f for m in earlier for f in (m, m**2, m * u)]
            for other in driving:
                if other > k:
                    w = s[other]
                    terms[f"{k} and {other}"] = [u * w, u**2 * w, u * w**2]
                if other != k:
                    terms[f"{other} and earlier {k}"] = [m * s[other] for m in earlier]
        return terms
