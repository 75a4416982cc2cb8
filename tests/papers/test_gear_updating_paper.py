"""The updating chain of the gearbox paper on the virtual rig: what its figures become, and how often it succeeds.

Everything here simulates for minutes and is run with ``-m slow``.  Runs are shared through one store for each housing.
"""

from __future__ import annotations

import pytest

from discrepancy.validation.published import AGREES, DIFFERS
from gearbox.papers import gearbox as papers
from gearbox.papers.eq_18_response_surface import eq_18_chapter, figs_9_10
from gearbox.papers.updating_success import LOADS, SENSORS, Success, chain_on_rig, one_load, rig_recordings, success
from gearbox.signals.main_components import main_components
from gearbox.stage.stage import build

#: Chain on the rig whose truth lies inside the model.
DESIGNS = 10


def silent(text: str) -> None:
    """Swallow progress."""


def test_tables_that_need_no_simulation() -> None:
    rows = {r.what: r for chapter in (papers._geometry(), papers._table_5(), eq_18_chapter((1,))) for r in chapter.rows}
    assert rows["Hertz stiffness K (Eqs. 15 to 17), N/mm^1.5"].why.startswith("+2.5 %")
    stated = [r for what, r in rows.items() if what.endswith("(as stated)")]
    assert [r.ours for r in stated] == ["0.437", "0.564"]
    assert all(r.verdict == DIFFERS for r in stated)
    best = next(r for what, r in rows.items() if what.startswith("largest value"))
    # 0.76075 to five figures: PAPER 0.752 was found, the surface's own maximum is 0.7607.
    assert float(best.ours) == pytest.approx(0.7607, abs=1.5e-4)
    assert best.verdict == DIFFERS


def test_virtual_main_components_of_table_6() -> None:
    """Within 1 % for the four conditions of Table 5; at 1000 r/min to the resolution of half a second."""
    from gearbox.files.operating_condition import OperatingCondition

    stage = build()
    for name, rpm, torque, _, meshes, _ in papers.TABLE_5_6[3:]:
        condition = OperatingCondition(rpm, torque, name)
        assert condition.mesh_frequency(32) == pytest.approx(meshes[0], abs=0.05)
        signals = stage.vibration({}, condition, 0.5)
        for sensor in ("a_input_seat_y", "a_output_seat_z"):
            assert main_components(signals[sensor], condition.mesh_frequency(32)).worst < 1e-3


# -------------------------------------------------------------------- slow


@pytest.fixture(scope="module")
def recordings():
    return {housing: one_load(rig_recordings(housing, silent)) for housing in ("flexible", "rigid")}


@pytest.mark.slow
@pytest.mark.parametrize("housing", ["flexible", "rigid"])
def test_fig_8_is_a_statement_about_the_housing(housing, recordings, gear_runs) -> None:
    chain = chain_on_rig(housing, recordings[housing], silent, gear_runs / f"gear-{housing}.jsonl")
    with chain.runs:
        found = papers.sensitivity_of(chain)
    ranges = dict(zip(found.space.names, found.ranges, strict=True))
    strongest = max(ranges.values())
    # As in the paper: the contact's stiffness and exponent are among the strong ones.
    assert ranges["K"] > 0.3 * strongest
    assert ranges["e_F"] > 0.3 * strongest
    # E: rigid gears feel it through K alone, and K is given.
    assert ranges["E"] == 0.0
    # D_P: negligible in the paper; here it scales the damping as C_D does, because the teeth are pressed in less.
    assert ranges["D_P"] > 0.3 * ranges["C_D"]
    # With the box the whole range of every parameter moves the similarity by a tenth; on rigid mounts by half.
    assert strongest < 0.2 if housing == "flexible" else strongest > 0.3


@pytest.mark.slow
def test_figs_9_and_10(recordings, gear_runs) -> None:
    chain = chain_on_rig("rigid", recordings["rigid"], silent, gear_runs / "gear-rigid.jsonl")
    with chain.runs:
        result = chain.run()
    study = result.choice.study
    third, second = (study[study["order"] == order].set_index("points") for order in (3, 2))
    assert sorted(third.index) == [25, 30, 35, 40, 45, 50]
    # The paper's statements that hold here: the cubic fits its points better, and at 25 points it overfits.
    assert (third["r2"] > second["r2"]).all()
    assert third["r2"].min() > 0.9
    assert third.loc[25, "r2"] - third.loc[25, "r2_loo"] > 0.1
    # Above 40 points the third order predicts better too.
    assert (
        third.loc[[45, 50], "test_mean_relative_error"].mean() < second.loc[[45, 50], "test_mean_relative_error"].mean()
    )
    assert (
        third.loc[[45, 50], "test_mean_relative_error"].mean() < third.loc[[25, 30], "test_mean_relative_error"].mean()
    )
    rows = [r for c in (figs_9_10(result), papers.similarity_chapter(result)) for r in c.rows]
    assert all(r.why or r.verdict == AGREES for r in rows)
    assert any("lost" in r.ours for r in rows)


def _held_out_improve(outcome: Success) -> list[bool]:
    """Whether every design raises the similarity, for each of conditions 1 to 3."""
    return [
        min(after) > before
        for after, before in zip(zip(*outcome.others, strict=True), outcome.others_start, strict=True)
    ]


@pytest.mark.slow
def test_true_similarity_rises_where_the_truth_lies_inside_the_model(recordings, gear_runs) -> None:
    """At least 9 of 10 designs, and above 0.7 under the three other conditions."""
    outcome = success("rigid", recordings["rigid"], silent, gear_runs / "gear-rigid.jsonl", range(DESIGNS))
    assert outcome.rises >= 9
    assert outcome.above >= 9
    assert _held_out_improve(outcome) == [True, True, True]


@pytest.mark.slow
@pytest.mark.parametrize("objective", ["similarity", "amplitudes"])
def test_with_manufacturing_errors_three_loads_improve_every_condition_held_out(
    objective, gear_runs, record_property
) -> None:
    """One recording improves those at higher loads and makes condition 1, at 50 N m, worse; the page has the values.

    The success rate is reported, not asserted.
    """
    made = rig_recordings("rigid", silent, manufacturing=1.0)
    kept, seeds = gear_runs / "gear-rigid.jsonl", range(3)
    if objective == "similarity":
        outcome = success("rigid", one_load(made), silent, kept, seeds)
    else:
        outcome = success("rigid", made, silent, kept, seeds, used=LOADS, objective=objective, sensors=SENSORS)
    assert _held_out_improve(outcome) == [objective == "amplitudes", True, True]
    assert max(outcome.bounds) < 1.0
    record_property("accepted", f"{outcome.rises} of {outcome.designs}: {outcome.start:.3f} to {outcome.optimum}")
