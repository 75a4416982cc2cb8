"""The example notebooks run from top to bottom, with fewer recordings, and are kept without outputs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
NOTEBOOKS = sorted(EXAMPLES.glob("*.ipynb"))


def _source(path: Path) -> dict:
    return json.loads(path.read_text(encoding="utf-8"))


def _run(path: Path, quick: dict[str, str], folder: Path) -> str:
    """Run a notebook with other values of its settings; return all that it printed."""
    nbformat = pytest.importorskip("nbformat", reason="notebooks need nbformat, nbclient and ipykernel")
    nbclient = pytest.importorskip("nbclient", reason="notebooks need nbformat, nbclient and ipykernel")
    pytest.importorskip("ipykernel", reason="notebooks need nbformat, nbclient and ipykernel")
    notebook = nbformat.read(path, as_version=4)
    for old, new in quick.items():
        assert any(old in cell.source for cell in notebook.cells), old
        for cell in notebook.cells:
            cell.source = cell.source.replace(old, new)
    nbclient.NotebookClient(notebook, timeout=1200, kernel_name="python3").execute(cwd=str(folder))
    outputs = [o for cell in notebook.cells if cell.cell_type == "code" for o in cell.outputs]
    shown = [o.get("text", "") + "".join(o.get("data", {}).get("text/html", "")) for o in outputs]
    return "\n".join(shown)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_a_notebook_is_kept_without_outputs(path):
    cells = _source(path)["cells"]
    assert [c for c in cells if c["cell_type"] == "code" and (c["outputs"] or c["execution_count"])] == []


def test_the_axis_notebook_finds_the_friction(tmp_path):
    told = _run(EXAMPLES / "axis_with_hidden_friction.ipynb", {"TRIPS = 8": "TRIPS = 3"}, tmp_path)
    assert "coulomb_friction@guide" in told  # alone, or as the one that differs with direction
    assert "less error expected" in told
    assert "study.add('" in told
    assert "<table" in told  # the comparison shows itself


@pytest.mark.slow
def test_the_lift_notebook_ends_with_savings(tmp_path):
    quick = {"TRIPS = 10": "TRIPS = 2", "DRAWS = 40": "DRAWS = 3"}
    told = _run(EXAMPLES / "lift_from_trips_to_savings.ipynb", quick, tmp_path)
    saved = {line.split()[0]: float(line.split()[2]) for line in told.splitlines() if " saves " in line}
    assert saved["straightened"] > 0.0
    assert saved["both"] > saved["straightened"]
