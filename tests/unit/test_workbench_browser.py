"""The workbench in a real browser: the whole path by clicks, two studies in two tabs, and a process that has gone."""

from __future__ import annotations

import importlib.util
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from test_study_history import problem_of

ROOT = Path(__file__).resolve().parents[2]
RECORDS = """\
identify = ["run0.csv", "run1.csv"]
validate = ["run2.csv"]
[candidates]
include = ["coulomb_friction@*", "asymmetric_coulomb_friction@*", "constant_force@*", "sensor_offset@*"]
"""


def _module():
    spec = importlib.util.spec_from_file_location("workbench_walk", ROOT / "benchmarks" / "workbench_walk.py")
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


walking = _module()


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> Path:
    """The study file of a slide with dry friction that its model lacks."""
    folder = tmp_path_factory.mktemp("slide")
    problem = problem_of()
    for experiment in (*problem.identify, *problem.validate):
        record = experiment.record
        columns = [record.time, *(record.signals[n].values for n in ("drive.force", "carriage.position"))]
        header = "t_s,f_N,x_m"
        np.savetxt(folder / f"{record.name}.csv", np.column_stack(columns), "%.9g", ",", header=header, comments="")
    (folder / "slide.py").write_text(walking.MODEL, encoding="utf-8")
    (folder / "study.toml").write_text(walking.STUDY + RECORDS, encoding="utf-8")
    return folder / "study.toml"


@pytest.fixture(scope="module")
def browser():
    pytest.importorskip("uvicorn", reason="the workbench needs starlette and uvicorn")
    pytest.importorskip("playwright", reason="the browser is driven by playwright: pip install 'vtsdt[browser]'")
    if walking.chromium() is None:
        pytest.skip("Chromium is not installed (Debian: apt-get install chromium)")
    with walking.opened() as browser:
        yield browser


def test_the_whole_path_by_clicks_and_its_replay(browser, study, tmp_path):
    faults = []
    with walking.workbench(study, "--out", tmp_path) as (address, _):
        page = walking.page_of(browser, address)
        page.on("pageerror", lambda error: faults.append(str(error)))
        seen = walking.walk(page)
        assert faults == []
        assert set(seen.candidates) == {"coulomb_friction@guide", "asymmetric_coulomb_friction@guide"}
        assert [len(seen.stages[m]) for m in ("begin", "second", "undone", "best")] == [2, 3, 2, 3]
        assert seen.errors["undone"] == seen.errors["begin"]
        error = {m: float(e["carriage.position"].split()[0]) for m, e in seen.errors.items()}
        assert error["second"] < 0.5 * error["begin"]
        assert error["best"] < 0.5 * error["begin"]
        assert [row.split()[0] for row in seen.branches] == ["carriage.position"] * 2
        assert seen.branches[-1].split()[3] == seen.errors["best"]["carriage.position"].split()[0]  # A, held out
        assert seen.branches[-1].split()[5] == seen.errors["second"]["carriage.position"].split()[0]  # B
        assert all(Path(p).is_file() for p in seen.written)
        # a reload shows the same
        page.reload()
        page.locator("#stages li").nth(2).wait_for()
        assert page.locator("#stages li").all_inner_texts() == seen.stages["end"]
        page.set_viewport_size({"width": 400, "height": 900})
        page.locator(".zoom-panel").first.wait_for()
        for tab in page.locator("#tabs button").all():
            tab.click()
            page.locator(f'#view[data-view="{tab.get_attribute("data-view")}"]').wait_for()
            assert page.evaluate("document.documentElement.scrollWidth") <= 400, tab.inner_text()
    history = json.loads((tmp_path / "history.json").read_text(encoding="utf-8"))
    assert [s["action"] for s in history["steps"]] == ["add", "undo", "add", "search"]
    kept = [s["rmse"] for s in history["stages"]]
    assert walking.same_errors(walking.replayed_by_script(tmp_path / "steps.py"), kept)
    again = walking.replayed(study, tmp_path)
    assert [s["name"] for s in again] == [s["name"] for s in history["stages"]]
    for kept, stage in zip(history["stages"], again, strict=True):
        for part in ("identify", "validate"):
            assert {n: v["rmse"] for n, v in stage[part].items()} == kept["rmse"][part]


DRAWN = "() => { const draw = vtsdtZoom.draw; vtsdtZoom.draw = (...all) => (window.drawn = draw(...all)); }"


def test_another_record_keeps_the_zoom_and_paper_shows_what_was_out_of_sight(browser, study, tmp_path):
    with walking.workbench(study, "--out", tmp_path) as (address, _):
        page = walking.page_of(browser, address, "narrow")
        page.evaluate(DRAWN)
        record = page.locator('select[aria-label="record"]')

        def choose(name: str) -> list[float]:
            record.select_option(name)
            page.wait_for_function(f"() => window.drawn && drawn.plots[0].figure.record === '{name}'")
            return page.evaluate("drawn.plots.map((p) => [p.plot.scales.x.min, p.plot.scales.x.max])")

        whole = choose("run1")[0]
        page.locator(".zoom-bar button").first.click()
        page.wait_for_function(f"() => drawn.plots[0].plot.scales.x.min > {whole[0]}")
        closer = page.evaluate("wb.chosen.span")
        assert choose("run2") == [closer, closer]
        assert page.locator("button.leave").inner_text() == "Leave the visible stretch out"
        page.locator(".zoom-bar button").last.click()  # the whole record, and so is the next one
        page.wait_for_function("() => wb.chosen.span === null")
        assert choose("run0")[0] == whole

        page.set_viewport_size({"width": 400, "height": 300})
        page.evaluate("() => scrollTo(0, document.body.scrollHeight)")
        page.wait_for_function("() => drawn.plots.every((p) => !p.visible)")
        page.evaluate(f"drawn.show({closer[0]}, {closer[1]}, true)")
        page.wait_for_function("() => drawn.plots.every((p) => !p.figure.x)")
        assert page.evaluate("drawn.plots[0].plot.data[0][0]") == whole[0]  # nobody sees these old lines
        page.pdf()
        first = page.evaluate("drawn.plots.map((p) => p.plot.data[0][0])")
        assert first == pytest.approx([closer[0]] * 2, abs=0.02 * (closer[1] - closer[0]))
        page.route("**/figures*", lambda route: route.abort())  # the server has gone: old lines are not printed
        page.evaluate("drawn.plots.forEach((p) => { p.figure = { ...p.figure, x: '' }; p.stale = true; })")
        page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
        page.emulate_media(media="print")
        assert not page.locator(".zoom-panel:visible").count()


def test_a_stretch_is_left_out_and_used_again_by_clicks(browser, study, tmp_path):
    with walking.workbench(study, "--out", tmp_path) as (address, _):
        page = walking.page_of(browser, address)
        for _ in range(2):
            page.locator(".zoom-bar button").first.click()  # closer
        page.locator("button.leave", has_text="visible stretch").wait_for()
        before = page.locator("#errors").inner_text()
        page.locator("button.leave:enabled").click()
        page.locator("#changed li", has_text="left out: run0 from").wait_for()
        assert page.locator("#undo").get_attribute("title").startswith("Take the latest step back: leave out run0")
        page.locator("#changed .again:enabled").click()
        page.locator("#changed li").wait_for(state="detached")
        assert page.locator("#errors").inner_text() == before
        page.locator('#tabs button[data-view="branches"]').click()
        assert "without run0 from" in page.locator(".branch").nth(1).inner_text()
        page.locator(".branch .switch:enabled").click()
        page.locator("#changed li", has_text="left out: run0 from").wait_for()
        for taken in (4, 5, 6):
            page.locator("#undo:enabled").click()
            page.locator("#count", has_text=f"({taken})").wait_for()
        page.locator("#undo:disabled").wait_for()
        assert page.locator("#errors").inner_text() == before
    history = json.loads((tmp_path / "history.json").read_text(encoding="utf-8"))
    assert [s["action"] for s in history["steps"]] == ["leave_out", "use_again", "switch", *["undo"] * 3]


@pytest.mark.slow
def test_panels_are_zoomed_together_and_a_lost_browser_loses_nothing(browser, study, tmp_path):
    with walking.workbench(study, "--out", tmp_path) as (address, _):
        page = walking.page_of(browser, address)
        page.evaluate(DRAWN)
        for view in ("where", "time"):
            page.locator(f'#tabs button[data-view="{view}"]').click()
            page.locator(f'#view[data-view="{view}"]').wait_for()

        def spans() -> list[list[float]]:
            return page.evaluate("drawn.plots.map((p) => [p.plot.scales.x.min, p.plot.scales.x.max])")

        whole = spans()
        assert len(whole) == 2  # the output and its residual
        page.locator(".zoom-bar button").first.click()
        page.wait_for_function(f"() => drawn.plots[0].plot.scales.x.min > {whole[0][0]}")
        closer = spans()
        assert closer[0] == closer[1]
        box = page.locator(".zoom-panel .u-over").nth(1).bounding_box()  # drag over the residual
        across = box["y"] + 0.5 * box["height"]
        page.mouse.move(box["x"] + 0.25 * box["width"], across)
        page.mouse.down()
        page.mouse.move(box["x"] + 0.75 * box["width"], across, steps=5)
        page.mouse.up()
        page.wait_for_function(f"() => drawn.plots[0].plot.scales.x.min > {closer[0][0]}")
        closest = spans()
        assert closest[0] == closest[1]
        assert closest[0][1] - closest[0][0] == pytest.approx(0.5 * (closer[0][1] - closer[0][0]), rel=0.05)
        page.locator("#search:enabled").click()
        page.locator("#doing strong", has_text="search on").wait_for()
        page.close()
        page = walking.page_of(browser, address)
        page.locator("#verdict:not(:empty)").wait_for()
        assert "guide" in page.locator("#stages li").nth(2).inner_text()


def test_two_studies_in_two_tabs_and_one_process_that_goes(browser, study, tmp_path):
    ways = walking.workbench
    with ways(study, "--out", tmp_path / "one") as (one, process), ways(study, "--out", tmp_path / "two") as (two, _):
        first, second = (walking.page_of(browser, address) for address in (one, two))
        assert not first.locator("#gone").is_visible()
        process.kill()
        first.locator("#gone:visible").wait_for()
        assert "nothing that was finished is lost" in first.locator("#gone").inner_text()
        assert not second.locator("#gone").is_visible()
        second.reload()
        second.locator(".zoom-panel").first.wait_for()


def test_an_alignment_is_shown_and_its_threshold_moved(browser, tmp_path):
    height = np.linspace(0.0, 10.0, 101)
    deviation = 2.0 + np.sin(height)
    trip = {"name": "up", "direction": "up", "delta_mm": deviation.tolist()}
    content = {
        "height_m": height.tolist(),
        "estimate_mm": deviation.tolist(),
        "std_mm": np.full(101, 0.1).tolist(),
        "threshold_mm": 2.5,
        "trips": [trip],
    }
    (tmp_path / "alignment.json").write_text(json.dumps(content), encoding="utf-8")
    with walking.workbench("--lift", tmp_path) as (address, _):
        page = browser.new_page(viewport={"width": 400, "height": 900})
        page.goto(address)
        page.locator('body[data-shown="1"]').wait_for()
        assert "2 sections are above 2.50 mm" in page.locator("#sentences").inner_text()
        page.locator("#sliders input").fill("1000")
        page.locator("#sentences", has_text="No section is above").wait_for()
        assert page.evaluate("document.documentElement.scrollWidth") <= 400
