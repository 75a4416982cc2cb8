"""The state of every machine of a store, with its study's settings and with priors that the others give it."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from operation.fleet.fleet_view import fleet_priors
from operation.follow.command import MACHINES, study_priors
from operation.follow.settings import FollowSettings, read_settings
from operation.follow.watch import MachineState, watch
from operation.store.store import Store

__all__ = ["machine_states", "priors_of_others"]

Priors = Mapping[str, tuple[float, float]]


def machine_states(store: Store, now: float | None = None) -> dict[str, MachineState]:
    """Return the state of every machine of a store.

    Settings and priors are those of its study, where that is still there.  Where the study says ``fleet_prior``, the
    priors of its parameters are what the other machines say.

    Parameters
    ----------
    store : Store
    now : float, s, optional
        To tell which machines are silent.
    """
    given = _studies(store)
    alone = {m: _state(store, m, *given[m], now) for m in given}
    found = dict(alone)
    for machine, (settings, own) in given.items():
        if settings.fleet_prior and (priors := _from_others(alone, machine, own)):
            found[machine] = _state(store, machine, settings.with_drift_of(own), {**own, **priors}, now)
    return found


def priors_of_others(store: Store, machine: str, own: Priors) -> dict[str, tuple[float, float]]:
    """Return the priors of a machine's parameters that the other machines of a store give.

    Parameters
    ----------
    store : Store
    machine : str
        It need not be in the store yet.
    own : mapping of str to (float, float)
        Priors of the study: only of these parameters is anything returned.

    Returns
    -------
    dict of str to (float, float)
        Empty where there are fewer than five others.
    """
    given = {m: given for m, given in _studies(store).items() if m != machine}
    return _from_others({m: _state(store, m, *given[m], None) for m in given}, machine, own)


def _from_others(states: Mapping[str, MachineState], machine: str, own: Priors) -> dict[str, tuple[float, float]]:
    given = fleet_priors({m: s for m, s in states.items() if m != machine})
    return {n: prior for n, prior in given.items() if n in own}


def _studies(store: Store) -> dict[str, tuple[FollowSettings, Priors]]:
    """Return settings and priors of the study of each machine."""
    path = store.folder / MACHINES
    known = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    read: dict[Path, tuple[FollowSettings, Priors]] = {}
    found = {}
    for machine in store.machines:
        study = Path(known.get(machine, ""))
        if study.is_file() and study not in read:
            read[study] = read_settings(study), study_priors(study)
        settings, priors = read.get(study, (FollowSettings(), {}))
        found[machine] = replace(settings, machine=machine), priors
    return found


def _state(store: Store, machine: str, settings: FollowSettings, priors: Priors, now: float | None) -> MachineState:
    notes = [e.at for e in store.events(machine, "note") if e.detail.get("new_reference")]
    since = max(notes, default=-math.inf)
    return watch(store.judgements(machine), settings, priors, reference_from=since, now=now)
