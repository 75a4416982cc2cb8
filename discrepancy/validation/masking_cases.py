"""Masking pairs, drawn for the records of a virtual machine, and the diagnosis of a case with one.

A scan of the correct machine shows which effects do nearly opposite things.  Two of them are hidden with strengths at
which they cancel as far as possible; the rest is three times as large as a single effect must be to be visible.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.effects.kinds import kind_named
from discrepancy.statistics.masking_pairs import APART
from discrepancy.validation.cases import TIMES_VISIBLE, diagnosed, machine_module
from discrepancy.validation.trials import Trial

if TYPE_CHECKING:
    from discrepancy.statistics.scan_result import ScanResult

__all__ = ["masking_pair", "masking_trial"]

NEARLY_COLLINEAR = 0.9  # absolute correlation from which two effects count as the same or opposite; chosen
THIRD = 0.5  # share of the pair's rest that a third effect may explain alone, else it is the simpler answer; chosen
MOST_MISSTATED = 0.5  # share of a stated value by which it may be wrong; chosen

Strengths = Mapping[str, Mapping[str, float]]


def masking_trial(seed: int, machine: str = "axis") -> Trial:
    """Hide a masking pair and diagnose."""
    pair = masking_pair(seed, machine)
    if not pair:
        note = "no two effects mask each other on these records"
        return Trial(suite="masking", seed=seed, hidden=(), verdict="refused", found=(), note=note)
    return diagnosed("masking", seed, tuple(pair), machine, strengths=pair)


@lru_cache(maxsize=8)
def masking_pair(seed: int, machine: str = "axis") -> Strengths:
    """Return the strengths of a masking pair on the records of a seed; empty where there is none.

    Parameters
    ----------
    seed : int
    machine : str
        As of `discrepancy.validation.cases.machine_module`.

    Returns
    -------
    mapping of str to mapping of str to float
        ``kind@where``, and its strength by name.
    """
    from discrepancy.study.study import Study

    module = machine_module(machine)
    scan = Study(module.case(seed).problem(seed=seed)).explain().scan
    sizes = {f"{e['kind']}@{e['where']}": e["parameters"] for e in module.sizes(seed, list(module.names()))}
    stated = {
        n: [v.get("stated", 0.0) for k, v in p.items() if k in kind_named(n.partition("@")[0]).every_strength]
        for n, p in sizes.items()
    }
    rng = np.random.default_rng([seed, 17])
    pairs = _opposed(scan, {n: values[0] for n, values in stated.items() if len(values) == 1}, rng)
    if not pairs:
        return {}
    chosen = pairs[int(rng.integers(len(pairs)))]
    return {n: {kind_named(n.partition("@")[0]).strengths[0]: stated[n][0] + change} for n, change in chosen.items()}


def _opposed(scan: ScanResult, stated: Mapping[str, float], rng: np.random.Generator) -> list[dict[str, float]]:
    """Return pairs of candidates with one strength and no shape, by the strengths at which they cancel best."""
    assert scan.scorer is not None
    columns = scan.scorer.columns
    owners = [g.candidate for g in columns.groups]
    rows = [
        r
        for r in scan.rows
        if r.name in stated and r.expected_strength.size == 1 and owners.count(columns.groups[r.group].candidate) == 1
    ]
    Z = columns.Z.selected([columns.groups[r.group].columns for r in rows]).matrix()
    size = [float(columns.R[r.group][0, 0]) for r in rows]
    one_sided = [columns.groups[r.group].one_sided for r in rows]
    gram = Z.T @ Z
    every = np.concatenate([columns.Z[columns.groups[r.group].columns] for r in scan.rows], axis=1)
    owner = np.repeat(np.arange(len(scan.rows)), [r.expected_strength.size for r in scan.rows])
    pairs = []
    for i in range(len(rows)):
        for j in range(i):
            rho = float(gram[i, j])
            if abs(rho) < NEARLY_COLLINEAR or 1.0 - rho**2 <= APART:
                continue
            left = (TIMES_VISIBLE * rows[i].critical_ratio) ** 2 * scan.typical_inflation  # LM of the two together
            a = np.sqrt(left / (1.0 - rho**2)) / size[i] * float(rng.choice([-1.0, 1.0]))
            b = -a * rho * size[i] / size[j]
            if (one_sided[i] and a < 0.0) or (not one_sided[i] and one_sided[j] and b < 0.0):
                a, b = -a, -b
            pair = {rows[i].name: float(a), rows[j].name: float(b)}
            together = a * size[i] * Z[:, i] + b * size[j] * Z[:, j]
            third = (every.T @ together) ** 2 / float(together @ together)
            shares = [s for s, k in zip(third, owner, strict=True) if scan.rows[k] not in (rows[i], rows[j])]
            small = all(not stated[n] or abs(x) <= MOST_MISSTATED * abs(stated[n]) for n, x in pair.items())
            if small and max(shares) < THIRD and not (one_sided[j] and b < 0.0):
                pairs.append(pair)
    return pairs
