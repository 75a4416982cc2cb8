"""An exchange step: what the accepted effects say of each other afterwards."""

from __future__ import annotations

from types import SimpleNamespace

from discrepancy.effects.effect import Effect
from discrepancy.search.moves.exchange import Exchange, propose_exchange
from discrepancy.stages.stage import AcceptedEffect, RivalExplanation

MOTOR = Effect(kind="sensor_gain", where="motor.torque", strengths={"gain": 0.1})
GUIDE = Effect(kind="sensor_gain", where="carriage.position", strengths={"gain": 0.1})
LATE = Effect(kind="sensor_delay", where="carriage.position", strengths={"delay": 1e-3})


def exchange() -> Exchange:
    return Exchange(index=2, old=MOTOR, new=GUIDE, stage=SimpleNamespace(), improvement=14.0)


def test_the_old_effect_becomes_the_first_alternative_and_the_new_one_is_none_any_more() -> None:
    other = RivalExplanation(
        kind="sensor_offset", where="motor.torque", delta_bic=20.0, refitted=True, indistinguishable=False
    )
    rivals = (
        RivalExplanation(kind=GUIDE.kind, where=GUIDE.where, delta_bic=3.0, refitted=True, indistinguishable=True),
        other,
    )
    after = exchange().applied_to(
        AcceptedEffect(effect=MOTOR, p_value=1e-6, delta_bic=-50.0, rivals=rivals), delta_bic=-64.0
    )
    assert (after.effect, after.p_value, after.delta_bic) == (GUIDE, 1e-6, -64.0)
    assert after.rivals == (
        RivalExplanation(kind=MOTOR.kind, where=MOTOR.where, delta_bic=14.0, refitted=True, indistinguishable=False),
        other,
    )


def test_the_others_stay_and_name_the_new_one_where_the_old_one_masked_them() -> None:
    after = exchange().applied_to(
        AcceptedEffect(effect=LATE, p_value=1e-6, delta_bic=-50.0, masked_by=str(MOTOR)), delta_bic=-9.0
    )
    assert (after.effect, after.delta_bic, after.masked_by) == (LATE, -9.0, str(GUIDE))


def test_a_single_effect_is_not_exchanged() -> None:
    def never(*args: object) -> None:
        raise AssertionError("nothing is to be fitted")

    assert propose_exchange([SimpleNamespace(effects=(MOTOR,))], never, never) is None
