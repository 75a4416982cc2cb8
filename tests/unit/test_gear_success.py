"""Counts of the updating chain's success, and directions lost, on the analytic stand-in of a gear stage."""

from __future__ import annotations

import pytest
from gear_stand_in import RANGES, START, TEETH, measured, stand_in

from discrepancy.validation.published import UNCHECKED
from gearbox.files.operating_condition import OperatingCondition
from gearbox.papers import updating_success as papers_chain
from gearbox.signals.recordings import Recording
from gearbox.updating.chain import UpdatingChain
from gearbox.updating.runs import Runs
from gearbox.updating.settings import UpdatingSettings
from gearbox.updating.virtual import Settings
from surrogate import DesignSpace

SPACE = DesignSpace.from_mapping(RANGES)
TRUTH = {**START, "K": 6.44e5, "C_D": 303.0, "e_F": 2.27}
LOADS = [(1000.0, 150.0), (1000.0, 75.0), (1000.0, 220.0), (1006.0, 50.0), (1005.0, 75.0), (1003.0, 100.0)]


def recordings(sidebands: float) -> list[Recording]:
    found = []
    for i, (speed, torque) in enumerate(LOADS):
        _, signals = measured(TRUTH, OperatingCondition(speed, torque), noise=0.1, sidebands=sidebands, seed=i)
        found.append(Recording(OperatingCondition(speed, torque, f"recording {i}"), signals))
    return found


@pytest.fixture
def stand_in_chain(monkeypatch):
    """The chapter with the stand-in in the place of the stage."""

    def chain(housing, made, progress, store=None, *, used=1, **changes):
        swarm = {"population": 20, "iterations": 40}
        given = {**changes, "sensors": ("seat", "base"), "options": swarm}
        return UpdatingChain(
            UpdatingSettings(space=SPACE, start=START, sensor="seat", driving_teeth=TEETH, **given),
            Runs(stand_in, Settings(driving_teeth=TEETH)),
            made[:used],
            made[used:],
        )

    monkeypatch.setattr(papers_chain, "chain_on_rig", chain)
    monkeypatch.setattr(papers_chain, "true_values", lambda: {n: TRUTH[n] for n in ("K", "C_D", "e_F")})
    one_design = tuple((name, clean, way, range(1)) for name, clean, way, _ in papers_chain.CASES)
    monkeypatch.setattr(papers_chain, "CASES", one_design)
    quick = {"points": (25,), "test": 4, "levels": 3, "identify": False}
    monkeypatch.setattr(papers_chain, "ONE_DESIGN", quick)


@pytest.mark.slow
def test_the_chapter_counts_what_the_chains_did(stand_in_chain) -> None:
    chapter = papers_chain.success_chapter(lambda text: None, "rigid", recordings(0.0), recordings(0.6))
    rows = {r.what: r for r in chapter.rows}
    rose = rows["truth inside the model, Eq. 8: optimum of the surface, simulated, above the start"]
    assert rose.ours.startswith("1 of 1")
    assert rose.verdict == UNCHECKED  # the paper has one design
    assert rows["errors of manufacturing, Eq. 7: parameters used"].verdict == UNCHECKED
    lost = [r for r in chapter.rows if r.what.startswith("directions of K, C_D, e_F")]
    assert len(lost) == 4
    # two lines of one sensor, less a lag and a gain, cannot fix three parameters; amplitudes over loads tell more
    assert lost[0].ours != "none"
    assert lost[1].ours.count(";") <= lost[0].ours.count(";")


def test_kept_simulations_of_another_model_are_dropped(tmp_path) -> None:
    store = tmp_path / "runs.jsonl"
    with Runs(stand_in, Settings(driving_teeth=32), store=store) as runs:
        runs.many([({**START, "K": k}, OperatingCondition(1000.0, 150.0)) for k in (5e5, 7e5)])

    def as_it_was(housing: str):
        return stand_in

    def changed(housing: str):
        return lambda values, *rest: stand_in({**values, "K": 1.01 * values["K"]}, *rest)

    assert not papers_chain.drop_if_outdated(store, as_it_was, "rigid")
    assert store.exists()
    assert papers_chain.drop_if_outdated(store, changed, "rigid")
    assert not store.exists()


def test_success_is_counted_against_start_and_limit() -> None:
    found = papers_chain.Success(
        start=0.6,
        optimum=(0.7, 0.59, 0.9),
        predicted=(1.1, 0.8, 0.9),
        taken=(0.7, 0.65, 0.9),
        others=((0.8, 0.71), (0.69, 0.9), (0.75, 0.75)),
        others_start=(0.5, 0.5),
        bounds=(1.0, 1.0),
    )
    assert (found.designs, found.rises, found.above) == (3, 2, 2)
    told = {r.what: r.ours for r in papers_chain._rows("x", found)}
    assert told["x: above 0.7 at conditions 1, 2 and 3"].startswith("2 of 3 (21 to 94 %): 0.690 to 0.800 (before 0.500")


def test_recordings_of_one_load_are_the_base_and_the_three_conditions() -> None:
    assert papers_chain.one_load(list("abcdef")) == list("adef")
    assert SPACE.names[:3] == papers_chain.TABLE_4
