"""At which connection a force is missing: what a free force at each place could explain of the residual.

At every place generic forces over speed, position and acceleration are applied to the linearised machine, and the
residual is regressed on the responses.  Everything that a recalibration could explain is projected out first.  The
share is that of blocks of time left out of the regression, so that many free coefficients give no advantage.  Functions
of time alone are not used: they could not be tested on other blocks.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from discrepancy.stages.residuals_along_motion import ResidualsAlongMotion
from discrepancy.statistics.hat_functions import hat_functions, quantile_knots
from discrepancy.statistics.projection import Layout, Projection, project
from discrepancy.statistics.whitening import identity
from estimation.response.perturbations import InputPerturbation
from multibody.base.parallel import available_cores

__all__ = ["examined_connections"]

_SPEED_KNOTS = 8
_POSITION_KNOTS = 6
_SAME = 0.999
"""Cosine of the responses to the same force from which two places cannot be distinguished."""
LEAST_SHARE = 0.05
"""Share of the error that has to follow from something before that is said."""
_CLOSE = 0.1
"""Difference of shares within which two places are listed as equally good."""


def examined_connections(residuals: ResidualsAlongMotion) -> tuple[tuple[dict[str, Any], ...], str]:
    """Return how much a force at each place would explain; none, and the reason, where that cannot be simulated."""
    from multibody.base.errors import SimulationError

    try:
        return tuple(failing_connections(residuals)), ""
    except SimulationError as error:
        return (), f"the connections of '{residuals.stage.name}' could not be examined: {error}"


def failing_connections(residuals: ResidualsAlongMotion) -> list[dict[str, Any]]:
    """Return, for every place that can be probed, how much of the residual a force there would explain.

    Parameters
    ----------
    residuals : ResidualsAlongMotion
        Of a stage whose system has probes.

    Returns
    -------
    list of dict
        ``place``, ``share`` (0 to 1), ``same_as`` (places where the same force over time would have the same
        effect on the outputs: only the motion that it follows can distinguish them), ``moves_with`` (rigidly coupled
        places) and ``sentence``; largest share first.
    """
    system = residuals.stage.system
    places = [p.name for p in system.places if f"probe.{p.name}" in system.input_names]
    moving = {n for m in residuals.motions for n in (m.name, *m.also)}
    places = [p for p in places if p in moving]
    if not places:
        return []
    weight = 1.0 / residuals.noise
    e = (residuals.values * weight).ravel()
    explained = _what_calibration_explains(residuals)
    e = explained.remove(e)
    folds = _folds(residuals)
    responses, common = _responses(residuals, places, weight)
    shares, seen = {}, {}
    for place in places:
        z = explained.remove(responses[place])
        shares[place] = _cross_validated(z, e, folds)
        seen[place] = explained.remove(common[place])
    groups = _indistinguishable(places, seen)
    rigid = {n: {m.name, *m.also} - {n} for m in residuals.motions for n in (m.name, *m.also)}
    entries = [
        {
            "place": p,
            "share": float(max(shares[p], 0.0)),
            "same_as": sorted(groups[p]),
            "moves_with": sorted(rigid[p]),
        }
        for p in sorted(places, key=lambda p: -shares[p])
    ]
    return [{**f, "sentence": _sentence(f, entries)} for f in entries]


def _sentence(entry: dict[str, Any], entries: list[dict[str, Any]]) -> str:
    place, share = entry["place"], entry["share"]
    if share < LEAST_SHARE:
        return f"{place}: a missing force here would explain none of the error."
    sentence = f"{place}: a missing force here would explain {100 * share:.0f} % of what calibration leaves"
    good = {f["place"] for f in entries if f["place"] != place and abs(f["share"] - share) < _CLOSE}
    twins = sorted(good.intersection(entry["same_as"]))
    if twins:
        sentence += f"; these sensors cannot tell it from a force at {', '.join(twins)}"
    if near := sorted(good.difference(twins)):
        sentence += f"; {', '.join(near)} would do nearly as well"
    if weaker := [p for p in entry["same_as"] if p not in good]:
        sentence += (
            f"; a force over time at {', '.join(weaker)} would look the same to the sensors, only the motion that it "
            "follows distinguishes the two"
        )
    return sentence + "."


def _what_calibration_explains(residuals: ResidualsAlongMotion) -> Projection:
    """Return the directions of the parameters, without priors, and of each record's own unknowns."""
    sens = residuals.linearised.sensitivities()
    free = replace(sens, prior_std=np.full(len(sens.names), np.inf))
    layout = Layout(tuple(len(block) for block in sens.blocks), residuals.values.shape[1])
    return project(identity(residuals.noise.tolist(), residuals.outputs, 1.0), free, layout)


def _folds(residuals: ResidualsAlongMotion) -> list[np.ndarray]:
    """Blocks as rows of the stacked outputs."""
    channels = residuals.values.shape[1]
    return [(b[:, None] * channels + np.arange(channels)).ravel() for b in residuals.blocks]


def _generic_forces(position: np.ndarray, speed: np.ndarray, acceleration: np.ndarray) -> list[np.ndarray]:
    forces = [np.ones_like(speed)]
    fast = max(float(np.quantile(np.abs(speed), 0.95)), 1e-300)
    forces.append(np.tanh(speed / (0.02 * fast)))
    for values, count in ((speed, _SPEED_KNOTS), (position, _POSITION_KNOTS)):
        knots = quantile_knots(values, count)
        if len(knots):
            # The hat functions sum to one, which the constant is already.
            forces += list(hat_functions(values, knots)[:, 1:].T)
    if np.ptp(acceleration) > 0.0:
        forces.append(acceleration / np.max(np.abs(acceleration)))
    return forces


def _common_forces(position: np.ndarray, speed: np.ndarray) -> list[np.ndarray]:
    """Return the forces that are applied at every place alike."""
    return [
        np.ones_like(speed),
        speed / max(float(np.max(np.abs(speed))), 1e-300),
        (position - position.mean()) / max(float(np.ptp(position)), 1e-300),
    ]


def _responses(
    residuals: ResidualsAlongMotion, places: list[str], weight: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Responses to the forces of each place, and to those that are the same at every place; each (n·channels, k)."""
    system = residuals.stage.system
    motion_of = {p.name: [n for n, _ in p.motion_names()] for p in system.places}
    lead = residuals.guides()[0].name
    runs = [residuals.linearised.nominal_outputs(i) for i in range(len(residuals.linearised.experiments))]
    table = {
        p: [
            _motion(run, p, motion_of[p], residuals.linearised.experiments[i].record.time) for i, run in enumerate(runs)
        ]
        for p in places
    }
    generic = {
        p: _split(
            _generic_forces(*(np.concatenate(x) for x in zip(*table[p], strict=True))),
            [len(t[0]) for t in table[p]],
        )
        for p in places
    }
    guide = table[lead if lead in table else places[0]]
    shared = [_common_forces(position, speed) for position, speed, _ in guide]
    rows, alike = residuals.values.size, len(shared[0])
    own = {p: np.empty((rows, len(generic[p][0]))) for p in places}
    common = {p: np.empty((rows, alike)) for p in places}
    end = 0
    for i, experiment in enumerate(residuals.linearised.experiments):
        dy = experiment.respond(
            residuals.linearised.slim,
            residuals.linearised.p,
            residuals.linearised.initial_state(i),
            perturbations=[InputPerturbation(f"probe.{p}", f) for p in places for f in (*shared[i], *generic[p][i])],
            sensors=residuals.linearised.sensors,
            workers=available_cores(),
        ).derivatives
        dy *= weight[:, None]
        flat = dy.reshape(-1, dy.shape[2])
        here, end = slice(end, end + len(flat)), end + len(flat)
        for p in places:  # filled in place: all at once they would take twice the memory
            of_place, flat = np.split(flat, [alike + own[p].shape[1]], axis=1)
            common[p][here], own[p][here] = np.split(of_place, [alike], axis=1)
    return own, common


def _motion(run: dict[str, np.ndarray], place: str, names: list[str], time: np.ndarray) -> tuple[np.ndarray, ...]:
    position, speed = (run[f"place.{place}.{n}"] for n in names[:2])
    acceleration = run.get(f"place.{place}.{names[2]}")
    return position, speed, np.gradient(speed, time) if acceleration is None else acceleration


def _split(forces: list[np.ndarray], lengths: list[int]) -> list[list[np.ndarray]]:
    cuts = np.cumsum(lengths)[:-1]
    return [list(parts) for parts in zip(*(np.split(f, cuts) for f in forces), strict=True)]


def _cross_validated(z: np.ndarray, e: np.ndarray, folds: list[np.ndarray]) -> float:
    """Share of the residual's energy explained in blocks by a fit to the others."""
    size = np.linalg.norm(z, axis=0)
    z = z[:, size > 1e-12 * max(float(size.max(initial=0.0)), 1e-300)]
    if z.shape[1] == 0:
        return 0.0
    z = z / np.linalg.norm(z, axis=0)
    grams = np.array([z[f].T @ z[f] for f in folds])
    sides = np.array([z[f].T @ e[f] for f in folds])
    total, side = grams.sum(axis=0), sides.sum(axis=0)
    ridge = 1e-6 * np.eye(len(total))
    gain = 0.0
    for g, s in zip(grams, sides, strict=True):
        c = np.linalg.solve(total - g + ridge, side - s)
        gain += float(2.0 * c @ s - c @ g @ c)
    return gain / max(float(e @ e), 1e-300)


def _indistinguishable(places: list[str], common: dict[str, np.ndarray]) -> dict[str, set[str]]:
    groups: dict[str, set[str]] = {p: set() for p in places}
    for k, a in enumerate(places):
        for b in places[k + 1 :]:
            x, y = common[a].ravel(), common[b].ravel()
            size = float(np.linalg.norm(x) * np.linalg.norm(y))
            if size > 0.0 and abs(float(x @ y)) > _SAME * size:
                groups[a].add(b)
                groups[b].add(a)
    return groups
