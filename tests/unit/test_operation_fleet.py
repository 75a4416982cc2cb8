"""Fleets: judged in parallel or on a cluster, causes told apart, scores with intervals, the page."""

from __future__ import annotations

import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from operation.fleet.fleet_view import fleet_priors, fleet_view
from operation.fleet.follow_fleet import follow_fleet
from operation.fleet.scores import MachineYear, detection_curve, scores
from operation.follow.settings import FollowSettings
from operation.follow.watch import watch
from operation.page.page import Advice, general_advice, write_page
from operation.statistics.patterns import SOMETHING_ELSE, Cause, Explanation, explain_courses
from operation.store.judgement import Judgement, Quantity
from operation.store.store import Event, Store

DAY = 86400.0


def judged(item: tuple[int, int]) -> tuple[str, Judgement]:
    """A machine whose friction is its number, on a day; what another process can find."""
    machine, day = item
    if day < 0:
        raise ValueError("a day before the first")
    value = 10.0 + machine + float(np.random.default_rng([machine, day]).standard_normal())
    friction = Quantity(value=value, std=1.0, unit="N", kind="parameter")
    return f"m{machine}", Judgement(
        key=f"{machine}-{day}", name=f"{day}", at=day * DAY, quantities={"friction": friction}
    )


def test_a_fleet_is_judged_in_parallel_and_a_call_that_fails_is_told(tmp_path: Path) -> None:
    items = [(m, d) for m in range(4) for d in range(10)]
    with Store(tmp_path) as store, ThreadPoolExecutor(2) as pool:
        run = follow_fleet(judged, [*items, (0, -1), (1, 3)], store, executor=pool)
        assert (run.records, run.new, run.failed) == (41, 40, 1)
        assert "a day before the first" in run.faults[0]
        assert store.machines == ("m0", "m1", "m2", "m3")
        assert len(store.judgements("m2")) == 10


@pytest.mark.slow
def test_a_cluster_of_dask_gives_the_same(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="the extra [dask] is not installed")
    items = [(m, d) for m in range(3) for d in range(4)]
    with Store(tmp_path / "here") as here, ThreadPoolExecutor(1) as pool:
        follow_fleet(judged, items, here, executor=pool)
        with (
            distributed.LocalCluster(
                n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
            ) as cluster,
            distributed.Client(cluster) as client,
            Store(tmp_path / "there") as there,
        ):
            client.upload_file(__file__)
            run = follow_fleet(judged, items, there, executor=client.get_executor())
            assert run.new == len(items)
            for machine in here.machines:
                for a, b in zip(here.judgements(machine), there.judgements(machine), strict=True):
                    assert a.quantities == b.quantities


CAUSES = {
    "all alike": Cause(pattern=np.array([-1.0, -1.0, -1.0]), size=2.0, sign=1),
    "the first": Cause(pattern=np.array([1.0, 0.0, 0.0]), size=2.0),
}
STEP, RAMP = (np.arange(40) >= 20).astype(float), np.clip(np.arange(40) - 19.5, 0.0, None) / 19.5


def explained(change: list[float], seed: int = 0, course: np.ndarray = STEP) -> tuple[Explanation, ...]:
    """Explain a change in forty records with a noise of 0.6."""
    rows = 5.0 + np.outer(course, change) + 0.6 * np.random.default_rng(seed).standard_normal((40, 3))
    return explain_courses(rows, {"at once": STEP}, {"at once": CAUSES}, np.full(3, 2.0))


def test_causes_are_told_apart_by_what_they_change_together() -> None:
    hits = 0
    for seed in range(50):
        best = explained([-1.5, -1.5, -1.5], seed)[0]
        hits += best.cause == "all alike" and best.interval()[0] < 1.5 < best.interval()[1]
    assert hits >= 43  # 95 % of 50, less three standard errors
    assert explained([1.5, 0.1, -0.1])[0].cause == "the first"
    assert explained([1.5, 0.1, 1.4])[0].cause == SOMETHING_ELSE
    rising = explained([1.5, 1.5, 1.5])
    assert rising[0].cause == SOMETHING_ELSE  # the first cause can only lower them
    assert sum(e.probability for e in rising) == pytest.approx(1.0)


def test_causes_with_one_pattern_are_told_apart_by_their_course() -> None:
    pattern = np.array([1.0, 1.0, 1.0])
    causes = {
        "at once": {"oiled": Cause(pattern=pattern, size=2.0)},
        "growing": {"worn": Cause(pattern=pattern, size=2.0)},
    }
    for course, name in ((STEP, "oiled"), (RAMP, "worn")):
        rows = np.outer(course, [1.5, 1.5, 1.5]) + 0.4 * np.random.default_rng(1).standard_normal((40, 3))
        best = explain_courses(rows, {"at once": STEP, "growing": RAMP}, causes, np.full(3, 2.0), 0.15, 0.2)[0]
        assert best.cause == name
        assert best.probability > 0.9
        assert best.interval()[0] < 1.5 < best.interval()[1]


def test_the_units_of_the_quantities_change_no_probability() -> None:
    """Metres beside newtons: variances of 1e-9 m² must not be taken for zero beside those of a few N²."""
    units = np.array([1e-4, 1e-4, 1.0])
    causes = {"a rail": np.array([1.0, 0.0, 0.0]), "the sensor": np.array([0.0, 0.0, 1.0])}
    rows = 5.0 + np.outer(STEP, [0.0, 0.0, 3.0]) + 0.3 * np.random.default_rng(3).standard_normal((40, 3))

    def explained_in(unit: np.ndarray) -> dict[str, float]:
        given = {n: Cause(pattern=pattern * unit, size=4.0) for n, pattern in causes.items()}
        found = explain_courses(rows * unit, {"at once": STEP}, {"at once": given}, 4.0 * unit, 0.15, 0.2)
        return {e.cause: e.probability for e in found}

    alike, mixed = explained_in(np.ones(3)), explained_in(units)
    assert alike["the sensor"] > 0.9
    assert mixed == pytest.approx(alike, rel=1e-9, abs=1e-12)


def test_scores_of_years_with_known_truth() -> None:
    years = [
        MachineYear(machine="a", truth="wear", begins=100.0, days=365.0, alarms=(130.0, 200.0), named="wear"),
        MachineYear(machine="b", truth="wear", begins=100.0, days=365.0, alarms=(50.0,), named=""),
        MachineYear(machine="c", truth="wear", begins=200.0, days=365.0, alarms=(210.0,), named="drift"),
        MachineYear(machine="d", truth="", begins=0.0, days=365.0, alarms=()),
    ]
    (wear,), rate = scores(years)
    assert (wear.machines, wear.detected, wear.right, wear.median_days) == (3, 2, 1, 20.0)
    assert rate["false_alarms"] == 1
    assert rate["machine_years"] == pytest.approx((100 + 100 + 200 + 365) / 365.25)
    assert rate["interval"][0] < rate["per_year"] < rate["interval"][1]
    curve = detection_curve(years, "wear", np.array([5.0, 15.0, 40.0]))
    assert curve[:, 0] == pytest.approx([0.0, 1 / 3, 2 / 3])


@pytest.fixture
def fleet(tmp_path: Path) -> tuple[Store, dict]:
    """Eight machines, of which one lies outside, one has changed and one is silent."""
    rng, store = np.random.default_rng(7), Store(tmp_path / "store")
    for m in range(8):
        level = 10.0 + 0.5 * rng.standard_normal() + (9.0 if m == 5 else 0.0)
        for d in range(40):
            value = level + 0.3 * rng.standard_normal() + (3.0 if m == 2 and d >= 25 else 0.0)
            quantities = {"friction <b>": Quantity(value=value, std=0.3, unit="N", kind="parameter")}
            judgement = Judgement(key=f"{d}", name=f"{d}", at=(d + 20500) * DAY, quantities=quantities)
            store.add(f"lift {m}", judgement)
    states = {}
    for m in store.machines:
        now = (20500 + (60 if m == "lift 7" else 40)) * DAY
        states[m] = watch(store.judgements(m), FollowSettings(machine=m, false_alarms=0.05), now=now)
    return store, states


def test_the_fleet_gives_priors_thresholds_and_names_who_lies_outside(fleet) -> None:
    _, states = fleet
    view = fleet_view(states)["friction <b>"]
    assert view.outside[0][0] == "lift 5"
    assert view.interval[0] <= view.level <= view.interval[1]
    mean, std = fleet_priors(states)["friction <b>"]
    assert abs(mean - 11.0) < 3.0 * std
    assert fleet_view({m: states[m] for m in list(states)[:3]}) == {}


def test_the_page_says_what_is_the_matter_and_escapes_what_it_is_given(fleet, tmp_path: Path) -> None:
    store, states = fleet
    store.add_event(
        "lift 2", Event(kind="named", subject="x", at=0.0, raised=0.0, detail={"sentence": "<script>x</script>"})
    )
    path = write_page(tmp_path / "page.html", store, states, title="Lifts & others")
    text = path.read_text(encoding="utf-8")
    assert text.count("<script") == 1  # the page's own
    assert "http://" not in text.replace("http://www.w3.org", "")
    assert "Lifts &amp; others" in text
    assert "friction &lt;b&gt;" in text
    assert re.search(r"lift 2 <span class=\"word drifting\">drifting", text)
    assert re.search(r"lift 7 <span class=\"word no-data\">no data", text)
    assert "outside of the rest of the fleet: friction" in text
    assert text.count("<svg") == 8
    order = [text.index(f"lift {m} <span") for m in (7, 2, 0)]
    assert order == sorted(order)
    advice = write_page(
        tmp_path / "own.html",
        store,
        states,
        advice=lambda state, events: Advice(do="Oil it.", saves="2 J", sure="so so"),
    )
    assert "What it saves:</strong> 2 J" in advice.read_text(encoding="utf-8")
    assert general_advice(states["lift 0"], ()).do == "Nothing."
