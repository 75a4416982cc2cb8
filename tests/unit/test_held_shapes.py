"""Where the shapes of laws move to their likeliest, those by which dry friction fades or gives way stay."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from discrepancy.effects.effect import Effect
from discrepancy.evidence.likelihood import StageLikelihood

PORTS = ("mass.flange", "ground")


def test_the_place_of_a_bend_moves_and_what_friction_fades_by_stays() -> None:
    effects = (
        Effect(kind="cubic_stiffness", where="spring", ports=PORTS, strengths={"stiffness": 1.0}),
        Effect(kind="stribeck_friction", where="guide", ports=PORTS, strengths={"breakaway": 1.0}),
        Effect(kind="hysteresis", where="seal", ports=PORTS, strengths={"level": 1.0}),
    )
    stage: Any = SimpleNamespace(effects=effects, identify=SimpleNamespace(at_bound=("mass.m",)))
    likelihood = StageLikelihood(stage=stage)
    assert "cubic_stiffness.spring.centre" in likelihood.held
    staying = {"mass.m", "stribeck_friction.guide.v_stribeck", "hysteresis.seal.x_s"}
    assert staying <= set(likelihood.held_if_shapes_move)
    assert "cubic_stiffness.spring.centre" not in likelihood.held_if_shapes_move
