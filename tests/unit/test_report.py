"""The report: one page that opens offline, in the right order, readable on a phone; figures as files."""

from __future__ import annotations

import base64
import html
import json
import re
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from discrepancy.drawing.zoom_data import zoom_figure
from discrepancy.questions.unknown_force import UnknownCurve
from discrepancy.report.figures import zoomable
from discrepancy.report.schema import check_diagnosis
from discrepancy.report.wording import interval_words
from discrepancy.report.write import pictures, render, write_report
from discrepancy.stages.stage import RivalExplanation
from multibody.base.quantity_text import quantity_text

SECTIONS = [
    "answer",
    "compared",
    "falling",
    "missing",
    "where",
    "else",
    "hidden",
    "next",
    "parameters",
    "records",
    "how",
]


@pytest.fixture(scope="session")
def written(conclusion, evidence, tmp_path_factory):
    out = tmp_path_factory.mktemp("report")
    return out, write_report(conclusion, out, evidence)


@pytest.fixture(scope="session")
def page(written) -> str:
    return (written[0] / "report.html").read_text(encoding="utf-8")


def _text(page: str) -> str:
    body = re.sub(r"<(style|script)>.*?</\1>", " ", page, flags=re.S)
    return html.unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", body)))


def test_everything_is_written(written) -> None:
    out, paths = written
    assert all(p.is_file() and p.stat().st_size > 0 for p in paths)
    names = {p.name for p in paths}
    assert {
        "diagnosis.json",
        "report.html",
        "model.json",
        "falling_error.png",
        "over_time_1.png",
        "against_motion.png",
        "spectra.png",
        "candidates_before.png",
        "candidates_after.png",
        "parameters.png",
    } <= names
    assert set(paths) == {p for p in out.rglob("*") if p.is_file()}
    assert {p.name for p in (out / "stages").iterdir()} == {"0.json", "1.json", "2.json"}
    assert check_diagnosis(json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))) == []


def test_the_saved_model_is_the_updated_one(written, conclusion) -> None:
    from multibody import Model

    model = Model.load(written[0] / "model.json")
    assert "coulomb_friction.guide" in model.components
    assert model.build(probes=True).state_names == conclusion.final.system.state_names


def test_sections_stand_in_the_order_of_the_questions(page) -> None:
    assert re.findall(r'<section id="(\w+)">', page) == SECTIONS


def test_nothing_is_fetched_from_outside(page) -> None:
    assert not re.findall(r'(?:src|href)="(?!data:|#)[^"]*"', page)
    assert not re.search(r"@import|url\(", page)
    assert not re.search(r"fetch\(|XMLHttpRequest|import\(|WebSocket|sendBeacon", page)


def test_figures_are_in_the_page_and_are_those_beside_it(page, written) -> None:
    inside = {base64.b64decode(x) for x in re.findall(r'src="data:image/png;base64,([^"]+)"', page)}
    beside = {p.read_bytes() for p in written[0].glob("*.png")}
    zoomable = {p.read_bytes() for p in written[0].glob("over_time_*.png")}  # the page draws these itself
    assert len(zoomable) == 2
    assert inside == beside - zoomable
    assert all(alt.strip() for alt in re.findall(r'<img [^>]*alt="([^"]*)"', page))


def test_an_engineer_finds_what_it_is_and_how_to_confirm_it(page, conclusion) -> None:
    text = _text(page)
    kind = conclusion.accepted[0].effect.definition.text
    for expected in (
        kind.what,
        kind.causes,
        kind.confirm,
        "Chance alone can be ruled out",
        "95 % interval",
        "Stribeck friction",
        "clearly worse",
        "the load hardly changes in these records",
        "Move the carriage at 0.01 m/s",
        "'x_m' stands still for 0.4 s",
        "with_rests",
    ):
        assert expected in text, expected
    for jargon in ("score test", "MDE", "λ", "heteroscedastic", "nan", "None", "inf "):
        assert jargon not in text, jargon


def test_names_from_files_cannot_break_the_page(conclusion, evidence) -> None:
    found = render(replace(conclusion, name="<script>alert(1)</script>", warnings=("a < b & c",)), evidence, [])
    assert "<script>alert" not in found
    assert "a &lt; b &amp; c" in found


def test_other_answers_have_their_page(conclusion, evidence) -> None:
    stage = conclusion.final
    tied = replace(
        stage,
        accepted=replace(
            stage.accepted,
            rivals=(
                RivalExplanation(
                    kind="stribeck_friction", where="guide", delta_bic=1.0, refitted=True, indistinguishable=True
                ),
            ),
        ),
    )
    text = _text(render(replace(conclusion, verdict="ambiguous", stages=(*conclusion.stages[:-1], tied)), evidence, []))
    assert "These records cannot distinguish it from: Stribeck friction" in text

    two = replace(conclusion, stages=conclusion.stages[:2])
    evidence2 = replace(evidence, comparisons=evidence.comparisons[:2], after=evidence.before)
    text = _text(render(replace(two, verdict="nothing missing"), evidence2, []))
    assert "These records show no missing effect" in text
    assert "No effect is significant" in text

    x = np.linspace(0.0, 0.3, 9)
    curve = UnknownCurve(
        where="guide",
        regressor="position",
        regressor_unit="m",
        unit="N",
        x=x,
        force=np.cos(9 * x),
        std=np.full(9, 0.1),
        statement="a wave along the travel",
        p_value=1e-4,
    )
    unknown = replace(two, verdict="unknown effect", unknown=curve)
    drawn = pictures(unknown, evidence2)
    assert "unknown_force" in {p.name for p in drawn}
    assert "a wave along the travel" in _text(render(unknown, evidence2, drawn))

    # Compared only: nobody asked what is missing, and the page does not pretend that somebody did.
    page = render(replace(two, verdict=""), evidence2, [])
    assert re.findall(r'<section id="(\w+)">', page) == [s for s in SECTIONS if s not in ("missing", "else", "hidden")]


def test_without_held_out_records_the_page_says_so(conclusion, tmp_path) -> None:
    alone = replace(conclusion, stages=tuple(replace(s, validate=None) for s in conclusion.stages))
    write_report(alone, tmp_path)
    text = _text((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "No record was held out" in text


def test_drawing_leaves_matplotlib_as_it_was(conclusion) -> None:
    import matplotlib
    import matplotlib.pyplot as plt

    from discrepancy.report import effect_figures, figures

    rules, open_figures = dict(matplotlib.rcParams), plt.get_fignums()
    first, again = (figures.falling_error(conclusion) for _ in range(2))
    effect_figures.candidate_scores(conclusion.baseline.scan)
    assert dict(matplotlib.rcParams) == rules
    assert plt.get_fignums() == open_figures
    # The same study gives the same pictures.
    assert np.array_equal(*(np.asarray(_drawn(f)) for f in (first, again)))


def test_outputs_that_are_not_drawn_are_counted(conclusion, monkeypatch) -> None:
    from discrepancy.report import figures

    assert figures.falling_error(conclusion).get_suptitle() == ""
    monkeypatch.setattr(figures, "MOST_FALLING", 1)
    figure = figures.falling_error(conclusion)
    count = len(conclusion.baseline.outputs)
    assert figure.get_suptitle() == f"Drawn are the 1 of {count} outputs with the largest error against the noise."
    assert len(figure.axes) == 1 < count


def _drawn(figure):
    figure.canvas.draw()
    return figure.canvas.buffer_rgba()


def test_axes_have_names_and_units(conclusion, evidence) -> None:
    from discrepancy.report import effect_figures, figures

    made = [
        figures.falling_error(conclusion),
        figures.over_time(conclusion, evidence, "carriage.position"),
        figures.spectra(conclusion, evidence, ["drive.force"]),
    ]
    for figure in made:
        assert all(re.search(r"\[.+\]", a.get_ylabel()) for a in figure.axes)
    assert "µm" in made[0].axes[1].get_ylabel()
    bars = effect_figures.candidate_scores(conclusion.baseline.scan)
    assert bars.axes[0].get_xlabel() == "size of the effect in standard errors"


def test_the_axis_of_candidates_with_long_names_keeps_its_label_on_the_figure(conclusion, monkeypatch) -> None:
    from discrepancy.report import effect_figures

    monkeypatch.setattr(effect_figures, "_short", lambda kind: "friction with elastic displacement (hysteresis)")
    figure = effect_figures.candidate_scores(conclusion.baseline.scan)
    _drawn(figure)
    box = figure.axes[0].xaxis.label.get_window_extent()
    assert figure.axes[0].get_window_extent().width < box.width, "names so long that the label is wider"
    assert box.x0 >= 0.0
    assert box.x1 <= figure.bbox.x1


def test_legends_of_long_names_stay_on_the_figure(conclusion, evidence, monkeypatch) -> None:
    from discrepancy.report import figures

    name = "+ Stribeck friction (more friction at low speed) at guide"
    monkeypatch.setattr(figures, "stage_title", lambda stage: stage.name if stage.accepted is None else name)
    for figure in (
        figures.over_time(conclusion, evidence, "carriage.position"),
        figures.spectra(conclusion, evidence, ["drive.force"]),
    ):
        _drawn(figure)
        (legend,) = figure.legends
        assert "Stribeck" in " ".join(text.get_text() for text in legend.get_texts())
        box = legend.get_window_extent()
        assert box.x0 >= 0.0
        assert box.x1 <= figure.bbox.x1


def test_numbers_read_as_an_engineer_writes_them() -> None:
    assert quantity_text(9.996, "N") == "10.0 N"
    assert quantity_text(-0.0005, "m") == "−500 µm"
    assert quantity_text(0.0, "m") == "0 m"
    assert quantity_text(float("nan"), "N") == "not known"
    assert interval_words(12.3456, 12.0, 12.7, "N") == "12.3 N (95 % interval 12.0 to 12.7 N)"
    assert "no interval" in interval_words(1.0, float("-inf"), float("inf"), "N")


def _chromium(*arguments: str) -> subprocess.CompletedProcess[str]:
    program = next((p for p in ("chromium", "chromium-browser", "google-chrome") if shutil.which(p)), None)
    if program is None:
        pytest.skip("headless Chromium is not installed (Debian: apt-get install chromium)")
    return subprocess.run(
        [program, "--headless", "--no-sandbox", "--disable-gpu", "--virtual-time-budget=5000", *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.mark.parametrize("width", [390, 1200])
def test_the_page_fits_the_screen(page, tmp_path, width) -> None:
    """In a frame of this width: no sideways scrolling, every figure drawn, no error on the console."""
    probe = tmp_path / "probe.html"
    measure = """
const frame = document.querySelector('iframe');
frame.onload = () => {
  const page = frame.contentDocument, images = [...page.images];
  document.querySelector('pre').textContent = JSON.stringify({
    wide: page.documentElement.scrollWidth, given: frame.clientWidth, images: images.length,
    drawn: images.filter(i => i.complete && i.naturalWidth > 300).length,
    out: [...page.querySelectorAll('main *:not(.scroll *)')].filter(
      e => e.getBoundingClientRect().right > frame.clientWidth + 1).map(e => e.tagName).slice(0, 5),
    cut: [...page.querySelectorAll('.scroll')].filter(b => b.scrollWidth > b.clientWidth + 1).map(b => b.innerText),
    tables: [...page.querySelectorAll('table')].filter(t => !t.closest('.scroll, .zoom')).length});
};"""
    probe.write_text(
        f'<!DOCTYPE html><meta charset="utf-8"><link rel="icon" href="data:,"><pre></pre>'
        f'<iframe style="width:{width}px;height:900px;border:0"></iframe><script>{measure}'
        f"frame.srcdoc = new "
        f"TextDecoder().decode(Uint8Array.from(atob('{base64.b64encode(page.encode()).decode()}'), "
        f"c => c.charCodeAt(0)));</script>",
        encoding="utf-8",
    )
    run = _chromium("--enable-logging=stderr", "--dump-dom", probe.as_uri())
    seen = json.loads(html.unescape(re.search(r"<pre>(.*?)</pre>", run.stdout, re.S).group(1)))
    assert seen["given"] == width
    assert seen["wide"] <= width, seen
    assert seen["out"] == []
    assert seen["tables"] == 0
    if width < 400:
        assert seen["cut"] == []
    assert seen["images"] == seen["drawn"] == page.count("<img ")
    assert "CONSOLE" not in run.stderr, run.stderr


def test_the_first_screen_has_answer_certainty_errors_and_what_to_do(written):
    page = _text((written[0] / "report.html").read_text(encoding="utf-8"))
    first = page[: page.index("What was compared")]
    for heading in ("How sure", "Error before and after", "What to do"):
        assert heading in first


def test_an_error_that_stays_is_called_unchanged(conclusion, evidence) -> None:
    recalibrated = conclusion.stages[1]
    same = replace(conclusion, stages=(*conclusion.stages[:2], replace(recalibrated, name="+ coulomb_friction@guide")))
    first = render(same, evidence, []).partition('id="compared"')[0]
    assert "(unchanged)" in first
    assert "bar new worse" not in first
    assert "(+0 %)" not in first


def test_what_is_to_be_measured_next_is_said_once(conclusion, evidence) -> None:
    confirm = conclusion.accepted[0].effect.definition.text.confirm
    advised = replace(conclusion, next_measurement=(f"To tell one from another: {confirm} For the other: look.",))
    for one in (replace(conclusion, next_measurement=()), advised):
        first = _text(render(one, evidence, []).partition('id="compared"')[0])
        assert first.count(confirm) == 1


def test_zoomable_figures_are_in_the_page_and_need_nothing_from_outside(written):
    page = (written[0] / "report.html").read_text(encoding="utf-8")
    assert "vtsdtZoom.draw" in page
    assert "leeoniya/uPlot" in page  # the library itself


def test_a_page_of_six_outputs_stays_below_3_mb(page, conclusion, evidence) -> None:
    """White noise in measurement and models keeps the most rows of a figure; the rest of a page hardly grows."""
    rng = np.random.default_rng(1)
    time = np.arange(200_000) * 1e-3
    signal = replace(evidence.comparisons[-1].of()[0], time=time, measured=rng.standard_normal(time.size))
    models = [(name, "after", rng.standard_normal(time.size)) for name in ("recalibrated", "with an effect")]
    largest = len(json.dumps(zoom_figure(signal, models)))
    drawn = len(conclusion.final.outputs)
    assert len(page) + (6 - drawn) * largest < 3_000_000
    assert len(json.dumps(zoomable(conclusion, evidence))) <= drawn * largest
