"""Pairs are offered of candidates only: what a parameter of the model does as well is none."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from discrepancy.evidence import moves


@pytest.mark.parametrize("owned", [False, True])
def test_what_a_parameter_does_as_well_stands_in_no_pair(monkeypatch, owned: bool) -> None:
    """Its law is not among the candidates: the catalogue's may be another of the same kind."""
    rows = [SimpleNamespace(name=f"{kind}@rail", kind=kind, where="rail") for kind in ("coulomb_friction", "backlash")]
    pair = SimpleNamespace(rows=rows, gain=1000.0)

    class Scores:
        def __init__(self, scan: Any, excluded: Any) -> None:
            self.excluded = excluded

        def masking(self) -> list[Any]:
            return [] if self.excluded(*rows) else [pair]

    candidates = [SimpleNamespace(name=r.name, entry=r.name, gain=1.0) for r in rows[owned:]]
    monkeypatch.setattr(moves, "PairScores", Scores)
    monkeypatch.setattr(moves, "effect_of", lambda entry, row, effects: entry)
    offered = moves.pairs(
        SimpleNamespace(scan=None, candidates=candidates),  # type: ignore[arg-type]
        SimpleNamespace(effects=()),  # type: ignore[arg-type]
    )
    assert [p.effects for p in offered] == ([] if owned else [("coulomb_friction@rail", "backlash@rail")])
