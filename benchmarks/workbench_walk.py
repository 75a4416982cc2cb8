"""Walk through the workbench in a browser, as a person does, and measure how long things take.

``python benchmarks/workbench_walk.py`` writes recordings of a virtual axis with dry friction that its model lacks,
opens the study, adds the second-best candidate, undoes it, adds the best, looks at both side by side, lets the search
go on, exports, and takes the steps again with ``vtsdt diagnose --resume`` and with the exported script.  It prints what
it does and how long things took, there and on two heavier studies; ``--page docs/benchmarks/workbench.md`` writes them
into that page, and ``--pictures docs/images`` makes the pictures of docs/howto/workbench.md.  ``--only walk``, ``--only
slider`` and ``--only zoom`` run a part alone.  It needs the packages of the extra ``browser`` and Chromium.
"""

from __future__ import annotations

import argparse
import datetime
import importlib.util
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

__all__ = [
    "Seen",
    "chromium",
    "opened",
    "page_of",
    "replayed",
    "replayed_by_script",
    "same_errors",
    "walk",
    "workbench",
]

PATIENCE = 300.0  # s, for whatever the page computes: computers that run these tests may have other work
SIZES = {"wide": (1400, 1000), "narrow": (400, 900)}
FILES = {"model": "model.json", "fmu": ".fmu", "script": "steps.py", "report": "report.html"}
PICTURES = ("predicted", "branches")  # moments of the walk that the docs show, at both sizes
COLOURS = 96  # of a picture: text and lines stay sharp, and the file is a third as long


def chromium() -> str | None:
    """Return the path of Chromium or Chrome, or None where there is none."""
    names = ("chromium", "chromium-browser", "google-chrome")
    return next((path for name in names if (path := shutil.which(name))), None)


@contextmanager
def opened() -> Iterator[Browser]:
    """Start a browser without a window."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium(), args=["--no-sandbox"])
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def workbench(*words: str | Path) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Start ``vtsdt open`` with some words; yield the page's address and the process."""
    command = [sys.executable, "-m", "vtsdt", "open", *map(str, words), "--no-browser"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        first = process.stdout.readline()
        found = re.search(r"http://\S+", first)
        if found is None:
            raise RuntimeError(f"vtsdt open printed no address: {first}{process.communicate()[1]}")
        yield found[0], process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=30)
        except subprocess.TimeoutExpired:
            process.kill()


def page_of(browser: Browser, address: str, size: str = "wide") -> Page:
    """Return the open page once its first figures stand."""
    width, height = SIZES[size]
    page = browser.new_page(viewport={"width": width, "height": height})
    page.set_default_timeout(1000.0 * PATIENCE)
    page.goto(address)
    page.locator(".zoom-panel").first.wait_for()
    return page


@dataclass
class Seen:
    """What was seen on a walk.

    Parameters
    ----------
    errors : dict
        Of the outputs as their cards show them, by the moment: ``"begin"``, ``"second"``, ``"undone"``, ``"best"``,
        ``"end"``.
    branches : list of str
        What the table of two branches says of the outputs, after the best was added beside the second.
    stages : dict of str to list of str
        Titles of the stages at the same moments.
    candidates : list of str
        The two best, as the page listed them.
    measures : dict of str to list of float, ms
        Each time that it was taken.
    written : list of str
        Files that were exported.
    """

    errors: dict[str, dict[str, str]] = field(default_factory=dict)
    stages: dict[str, list[str]] = field(default_factory=dict)
    candidates: list[str] = field(default_factory=list)
    branches: list[str] = field(default_factory=list)
    measures: dict[str, list[float]] = field(default_factory=dict)
    written: list[str] = field(default_factory=list)


def walk(
    page: Page,
    picture: Callable[[str], None] = lambda name: None,
    say: Callable[[str], None] = lambda text: None,
) -> Seen:
    """Take the whole path on an open page: add the second-best candidate, undo, add the best, search on, export.

    Parameters
    ----------
    page : Page
    picture : callable
        Called with the name of what the page shows.
    say : callable
        Called with a line for everything that is done.
    """
    seen = Seen()

    def look(moment: str) -> None:
        page.locator("#doing:not(:has(progress))").wait_for()
        cards = page.locator("#errors .panel").all()
        seen.errors[moment] = {c.locator("h3").inner_text(): c.locator(".now").inner_text() for c in cards}
        seen.stages[moment] = page.locator("#stages li").all_inner_texts()
        say(f"{moment:8} {seen.stages[moment][-1]:50} {seen.errors[moment]}")

    def choose(rank: int) -> str:
        card = page.locator(".candidate").nth(rank)
        card.wait_for()
        name = card.get_attribute("data-name") or ""
        drawn = int(page.locator("body").get_attribute("data-figures") or 0)
        card.locator(".head").click()
        page.locator(f'body[data-figures="{drawn + 1}"]').wait_for()
        return name

    def add() -> None:
        page.locator(".candidate.chosen .add:enabled").click()
        page.locator("#stages li").nth(2).wait_for()
        page.locator("#undo:enabled").wait_for()

    firsts = seen.measures["first picture"] = []
    for _ in range(3):
        page.reload()
        page.locator("body[data-figures]").wait_for()
        firsts.append(page.evaluate("wb.times.first"))
        say(f"first picture {firsts[-1]:.0f} ms")
    page.locator(".candidate").first.wait_for()
    look("begin")
    picture("opened")
    predictions = seen.measures["linear prediction"] = []
    for rank in (0, 1, 0, 1):
        second = choose(rank)
        predictions.append(page.evaluate("wb.times.last"))
        say(f"linear prediction of {second} {predictions[-1]:.0f} ms")
    page.locator(".candidate.chosen img:visible").wait_for()
    picture("predicted")
    add()
    look("second")
    page.locator("#undo").click()
    page.locator("#redo:enabled").wait_for()
    look("undone")
    best = choose(0)
    seen.candidates = [best, second]
    add()
    look("best")
    page.locator(".candidate").first.wait_for()
    picture("added")
    page.locator('#tabs button[data-view="branches"]').click()
    page.locator("body[data-branches]").wait_for()
    seen.branches = page.locator("table.errors tbody tr").all_inner_texts()
    say(f"two branches: {'; '.join(' '.join(row.split()) for row in seen.branches)}")
    picture("branches")
    page.locator('#tabs button[data-view="time"]').click()
    page.locator("#search:enabled").click()
    page.locator("#verdict:not(:empty)").wait_for()
    page.locator("#search:enabled").wait_for()
    look("end")
    # a unit needs the extra [fmi]
    files = FILES if importlib.util.find_spec("fmpy") else {k: v for k, v in FILES.items() if k != "fmu"}
    for what, name in files.items():
        page.locator(f"[data-export={what}]").click()
        page.locator("#written", has_text=name).wait_for()
        seen.written += page.locator("#written").inner_text().removeprefix("written: ").split(", ")
        say(f"written: {seen.written[-1]}")
    return seen


def replayed(study: Path, out: Path) -> list[dict[str, Any]]:
    """Take the steps of a history again with ``vtsdt diagnose --resume``; return the stages of its diagnosis."""
    command = [sys.executable, "-m", "vtsdt", "diagnose", str(study), "--resume", "--out", str(out), "--quiet"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=2 * PATIENCE, check=False)
    if run.returncode:
        raise RuntimeError(run.stderr)
    stages: list[dict[str, Any]] = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))["stages"]
    return stages


def same_errors(one: list[dict[str, dict[str, float]]], other: list[dict[str, dict[str, float]]]) -> bool:
    """Tell whether the errors of stages are the same, but for the last digits, which differ with the order of sums."""
    return len(one) == len(other) and all(
        set(a[part]) == set(b[part]) and all(math.isclose(a[part][n], b[part][n], rel_tol=1e-9) for n in a[part])
        for a, b in zip(one, other, strict=True)
        for part in ("identify", "validate")
    )


def replayed_by_script(script: Path) -> list[dict[str, dict[str, float]]]:
    """Run an exported script; return the errors of its stages by part and output."""
    errors = "[{p: s.rmse(p) for p in ('identify', 'validate')} for s in study.stages]"
    code = f"import json, runpy; study = runpy.run_path({str(script)!r})['study']; print(json.dumps({errors}))"
    command = [sys.executable, "-c", code]
    run = subprocess.run(command, capture_output=True, text=True, timeout=2 * PATIENCE, check=False, cwd=script.parent)
    if run.returncode:
        raise RuntimeError(run.stderr)
    found: list[dict[str, dict[str, float]]] = json.loads(run.stdout.splitlines()[-1])
    return found


# -------------------------------------------------------------------- as a program


def _bench(*arguments: str) -> None:
    subprocess.run([sys.executable, "-m", "vtsdt", "bench", *arguments, "--quiet"], check=True)


def _keep(page: Page, path: Path, *, whole: bool = False) -> None:
    """Save what a page shows, with few colours."""
    import io

    from PIL import Image

    image = Image.open(io.BytesIO(page.screenshot(full_page=whole))).convert("RGB")
    image.quantize(COLOURS).save(path, optimize=True)


def _slider(browser: Browser, folder: Path) -> dict[str, list[float]]:
    """Return how long each position of a slider takes on the lift of 17 states, ms, during the scoring and after it."""
    _bench("lift", "--out", str(folder))
    with workbench(folder / "study.toml", "--out", folder / "out") as (address, _):
        page = page_of(browser, address)
        slider = page.locator("#sliders input[type=range]").first
        slider.wait_for()
        measures: dict[str, list[float]] = {SLIDER_SCORING: [], SLIDER: []}
        for what, values in ((SLIDER_SCORING, range(400, 500, 20)), (SLIDER, range(500, 720, 20))):
            if what == SLIDER:
                page.locator(".candidate").first.wait_for()
            for value in values:
                drawn = int(page.locator("body").get_attribute("data-figures") or 0)
                slider.fill(str(value))
                page.locator(f'body[data-figures="{drawn + 1}"]').wait_for()
                measures[what].append(page.evaluate("wb.times.last"))
                _say(f"{what} {measures[what][-1]:.0f} ms")
    return measures


def _zoom(browser: Browser, folder: Path) -> list[float]:
    """Return how long each zoom takes in a record of a million samples, ms."""
    folder.mkdir(parents=True)
    (folder / "slide.py").write_text(MODEL, encoding="utf-8")
    (folder / "study.toml").write_text(STUDY + RECORDS, encoding="utf-8")
    write_slide(folder / "long.csv", 1_000_000)
    write_slide(folder / "short.csv", 5_000)
    with workbench(folder / "study.toml", "--out", folder / "out") as (address, _):
        page = page_of(browser, address)
        taken = []
        for _ in range(7):
            drawn = int(page.locator("body").get_attribute("data-figures") or 0)
            page.locator(".zoom-bar button").first.click()
            page.locator(f'body[data-figures="{drawn + 1}"]').wait_for()
            taken.append(page.evaluate("wb.times.last"))
            _say(f"zoom in 1e6 samples {taken[-1]:.0f} ms")
    return taken


MODEL = """
from multibody import Model
from multibody.library import ForceSource, Mass, Spring, ViscousFriction


def slide():
    model = Model("slide")
    carriage, drive = model.add("carriage", Mass(m=20.0)), model.add("drive", ForceSource())
    guide, spring = model.add("guide", ViscousFriction(viscous=30.0)), model.add("spring", Spring(stiffness=400.0))
    model.connect(carriage.flange, drive.flange, guide.a, spring.a)
    model.connect(guide.b, spring.b, model.ground)
    model.input("drive.force", drive.force)
    return model
"""
STUDY = """
[model]
build = "slide.py:slide"
[uncertain]
"guide.viscous" = { value = 30.0, std = 5.0, min = 0.0 }
[inputs]
"drive.force" = "f_N"
[outputs]
"carriage.position" = { column = "x_m", noise = 2e-4 }
[initial]
"carriage.position" = 0.0
[records]
time = "t_s"
"""
RECORDS = 'identify = ["long.csv"]\nvalidate = ["short.csv"]\n'


def write_slide(path: Path, samples: int) -> None:
    """Write a record of the slide beside it with another friction, at 1 kHz."""
    import numpy as np

    rng = np.random.default_rng(samples)
    time = np.arange(samples) * 1e-3
    force = 60.0 * np.sin(2 * np.pi * 0.31 * time) + 20.0 * np.sin(2 * np.pi * 2.3 * time)
    spec = importlib.util.spec_from_file_location("slide", path.with_name("slide.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    inputs, true = {"drive.force": (time, force)}, {"guide.viscous": 36.0}
    run = module.slide().build().simulate((0.0, float(time[-1])), inputs=inputs, times=time, parameters=true)
    x = run["carriage.position"] + 2e-4 * rng.standard_normal(samples)
    np.savetxt(path, np.column_stack([time, force, x]), "%.7g", ",", header="t_s,f_N,x_m", comments="")


def _say(text: str) -> None:
    print(text, flush=True)


def _axis(browser: Browser, folder: Path, pictures: Path | None) -> dict[str, list[float]]:
    """Take the whole path on the virtual axis and its replay; return the measures."""
    _say("write the recordings of a virtual axis")
    _bench("axis", "--hide", "coulomb_friction@guide", "--seed", "1", "--out", str(folder))
    out = folder / "out"
    with workbench(folder / "study.toml", "--out", out) as (address, _):
        page = page_of(browser, address)

        def resize(size: str) -> None:
            page.set_viewport_size(dict(zip(("width", "height"), SIZES[size], strict=True)))
            page.wait_for_timeout(500)  # until the figures have taken their new width

        def picture(shown: str) -> None:
            if pictures is None or shown not in PICTURES:
                return
            _keep(page, pictures / f"workbench-{shown}.png")
            resize("narrow")
            page.evaluate("document.getElementById('figures').scrollIntoView()")
            _keep(page, pictures / f"workbench-{shown}-narrow.png")
            page.evaluate("scrollTo(0, 0)")
            resize("wide")

        seen = walk(page, picture, _say)
    kept = json.loads((out / "history.json").read_text(encoding="utf-8"))["stages"]
    stages = replayed(folder / "study.toml", out)
    again = [{p: {n: v["rmse"] for n, v in s[p].items()} for p in ("identify", "validate")} for s in stages]
    first = [entry["rmse"] for entry in kept]
    _say(f"replayed by vtsdt diagnose --resume: {'the same' if same_errors(again, first) else 'OTHER'} numbers")
    by_script = same_errors(replayed_by_script(out / "steps.py"), first)
    _say(f"replayed by the exported script: {'the same' if by_script else 'OTHER'} numbers")
    return seen.measures


def main() -> None:
    """Take the walk, and print the measures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pictures", metavar="DIR", type=Path, help="make the pictures of the docs in this folder")
    parser.add_argument("--page", metavar="FILE", type=Path, help="write the measures into this page of the docs")
    parser.add_argument("--only", metavar="PART", choices=PARTS, action="append", help=f"one of {', '.join(PARTS)}")
    args = parser.parse_args()
    parts = args.only or PARTS
    if args.page is not None and len(parts) < len(PARTS):
        parser.error("the page holds the measures of all parts: leave --only out")
    if args.pictures is not None:
        args.pictures.mkdir(parents=True, exist_ok=True)
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False).stdout
    measures: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as name, opened() as browser:
        folder = Path(name)
        if "walk" in parts:
            measures |= _axis(browser, folder / "axis", args.pictures)
        if "slider" in parts:
            measures |= _slider(browser, folder / "lift")
        if "zoom" in parts:
            measures["zoom in 1e6 samples"] = _zoom(browser, folder / "long")
    lines = [_line(what, taken) for what, taken in measures.items()]
    print(*lines, sep="\n")
    if args.page is not None:
        text = args.page.read_text(encoding="utf-8")
        when = f"Measured on {datetime.date.today().isoformat()} at {commit.strip() or 'unknown'}"
        busy = f"with {os.getloadavg()[0]:.0f} programs at work on {os.cpu_count()} cores"
        table = "\n".join([f"{when}, {busy}.", "", *HEAD, *lines])
        begin, end = "<!-- measures -->\n", "<!-- /measures -->"
        before, rest = text.split(begin)
        args.page.write_text(f"{before}{begin}{table}\n{end}{rest.split(end)[1]}", encoding="utf-8")


PARTS = ("walk", "slider", "zoom")
SLIDER = "slider on the lift of 17 states"
SLIDER_SCORING = f"{SLIDER}, while candidates are scored"
#: What is measured, ms at most as it was asked for, by name.
ASKED = {
    "first picture": 2000,
    "linear prediction": 200,
    SLIDER: 100,
    SLIDER_SCORING: 100,
    "zoom in 1e6 samples": 200,
}
HEAD = ("| what | median [ms] | fastest to slowest [ms] | times | asked for [ms] |", "|---|---:|---:|---:|---:|")


def _line(what: str, taken: list[float]) -> str:
    """Return a line of the table of measures."""
    middle = sorted(taken)[len(taken) // 2]
    return f"| {what} | {middle:.0f} | {min(taken):.0f} to {max(taken):.0f} | {len(taken)} | {ASKED[what]} |"


if __name__ == "__main__":
    main()
