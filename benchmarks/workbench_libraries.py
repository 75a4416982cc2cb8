"""The same page in other libraries, measured: a million samples of two curves, thinned again at every zoom.

``python benchmarks/workbench_libraries.py panel`` (or ``nicegui``) serves the page, opens it in Chromium, zooms, and
prints the time to the first picture, the time of a zoom, and what the page loads from elsewhere.  It needs the library,
which the project itself does not, and the packages of the extra ``browser``.  ``docs/benchmarks/workbench.md`` has the
comparison.
"""

from __future__ import annotations

import argparse
import socket
import subprocess
import sys
import time
from typing import Any

import numpy as np
from workbench_walk import opened

from multibody.base.thinning import extreme_rows

SAMPLES, END, ROWS = 1_000_000, 1000.0, 1200
ZOOMS = 7

TIME = np.linspace(0.0, END, SAMPLES)
MEASURED = np.sin(2 * np.pi * 0.31 * TIME) + 1e-2 * np.random.default_rng(1).standard_normal(SAMPLES)
MODEL = 0.97 * np.sin(2 * np.pi * 0.31 * TIME)


def thinned(start: float, stop: float) -> dict[str, np.ndarray]:
    """Return a stretch of both curves with the extremes of every piece."""
    part = slice(*np.searchsorted(TIME, [start, stop]))
    rows = np.unique(np.concatenate([extreme_rows(y[part], ROWS) for y in (MEASURED, MODEL)]))
    return {"x": TIME[part][rows], "measured": MEASURED[part][rows], "model": MODEL[part][rows]}


def serve_panel(port: int) -> None:
    """Serve the page by Panel: a Bokeh figure whose source is filled again when its range changes."""
    import panel
    from bokeh.models import ColumnDataSource
    from bokeh.plotting import figure

    def page() -> Any:
        source = ColumnDataSource(thinned(0.0, END), name="source")
        plot = figure(name="plot", width=900, height=300, x_range=(0.0, END))
        for name, colour in (("measured", "black"), ("model", "blue")):
            plot.line("x", name, source=source, color=colour)

        def zoomed(attr: str, old: float, new: float) -> None:
            source.data = thinned(plot.x_range.start, new)

        plot.x_range.on_change("end", zoomed)
        return panel.pane.Bokeh(plot)

    panel.serve(page, port=port, show=False)


PANEL_READY = "window.Bokeh && Bokeh.index && Bokeh.index.roots && Bokeh.documents.some((d) => d._all_models.size > 20)"
PANEL_ZOOM = """async ([from, to]) => {
  const models = Bokeh.documents.flatMap((d) => [...d._all_models.values()]);
  const plot = models.find((m) => m.name === "plot"), source = models.find((m) => m.name === "source");
  const begun = performance.now();
  await new Promise((done) => {
    source.properties.data.change.connect(() => requestAnimationFrame(done));
    plot.x_range.setv({ start: from, end: to });
  });
  return performance.now() - begun;
}"""


def serve_nicegui(port: int) -> None:
    """Serve the page by NiceGUI: a Plotly figure that is sent again when its range changes."""
    from nicegui import ui

    def content(start: float, stop: float) -> dict[str, Any]:
        found = thinned(start, stop)
        lines = [
            {"type": "scattergl", "mode": "lines", "name": n, "x": found["x"].tolist(), "y": found[n].tolist()}
            for n in ("measured", "model")
        ]
        return {"data": lines, "layout": {"width": 900, "height": 300, "xaxis": {"range": [start, stop]}}}

    @ui.page("/")
    def page() -> None:
        plot = ui.plotly(content(0.0, END))

        def zoomed(event: Any) -> None:
            if "xaxis.range[0]" in event.args:
                plot.update_figure(content(event.args["xaxis.range[0]"], event.args["xaxis.range[1]"]))

        plot.on("plotly_relayout", zoomed)

    ui.run(port=port, show=False, reload=False)


NICEGUI_READY = "document.querySelector('.js-plotly-plot .main-svg')"
NICEGUI_ZOOM = """async ([from, to]) => {
  const plot = document.querySelector(".js-plotly-plot"), old = plot.data[0].x, begun = performance.now();
  plot.emit("plotly_relayout", { "xaxis.range[0]": from, "xaxis.range[1]": to });
  while (plot.data[0].x === old) await new Promise(requestAnimationFrame);
  await new Promise(requestAnimationFrame);
  return performance.now() - begun;
}"""

LIBRARIES = {
    "panel": (serve_panel, PANEL_READY, PANEL_ZOOM),
    "nicegui": (serve_nicegui, NICEGUI_READY, NICEGUI_ZOOM),
}


def main() -> None:
    """Serve a page, or measure it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("library", choices=list(LIBRARIES))
    parser.add_argument("--serve", metavar="PORT", type=int, help="serve the page and nothing else")
    args = parser.parse_args()
    serve, ready, zoom = LIBRARIES[args.library]
    if args.serve:
        serve(args.serve)
        return
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    server = subprocess.Popen([sys.executable, __file__, args.library, "--serve", str(port)])
    try:
        wait_for(port)
        with opened() as browser:
            page = browser.new_page()
            outside: list[str] = []
            page.on("request", lambda r: outside.append(r.url) if "127.0.0.1" not in r.url else None)
            for _ in range(2):  # the first time the server imports what it needs
                begun = time.perf_counter()
                page.goto(f"http://127.0.0.1:{port}/")
                page.wait_for_function(ready, timeout=120_000)
                first = time.perf_counter() - begun
            taken = sorted(page.evaluate(zoom, [10.0 * k, 1000.0 - 40.0 * k]) for k in range(1, ZOOMS + 1))
            print(f"{args.library}: first picture {1e3 * first:.0f} ms; zoom {taken[ZOOMS // 2]:.0f} ms", end=" ")
            print(f"({taken[0]:.0f} to {taken[-1]:.0f})")
            print(f"from outside: {', '.join(sorted({u for u in outside if u.startswith('http')})) or 'nothing'}")
    finally:
        server.terminate()
        server.wait(30)


def wait_for(port: int, patience: float = 120.0) -> None:
    """Return when something listens at a port of this computer."""
    end = time.monotonic() + patience
    while time.monotonic() < end:
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.2)
    raise RuntimeError(f"nothing listens at port {port}")


if __name__ == "__main__":
    main()
