"""The example of the page on FMUs runs as it is pasted, and ends with the effect that was hidden."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from multibody.fmi.compiler import c_compiler

pytest.importorskip("fmpy", reason="needs fmpy: pip install 'vtsdt[fmi]'")
pytestmark = pytest.mark.skipif(c_compiler() is None, reason="needs a C compiler")

ROOT = Path(__file__).resolve().parents[2]
SECTION = "### From FMU and CSV to the named effect\n"


@pytest.mark.slow  # records are made, models of a fresh unit are compiled
def test_the_pages_example_runs_as_it_stands(tmp_path: Path) -> None:
    """Run it in order: what is to be saved is saved under the last name in the text before it."""
    page = (ROOT / "docs/howto/fmu.md").read_text(encoding="utf-8")
    section = page.partition(SECTION)[2].partition("\n- **Names**")[0]
    parts = re.split(r"```(\w+)\n(.*?)```\n", section, flags=re.DOTALL)
    assert len(parts) == 16, "the example has five pieces, and text before and after each"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    for text, kind, piece in zip(parts[0::3], parts[1::3], parts[2::3], strict=False):
        if kind == "sh":
            commands = re.sub(r"^vtsdt ", f"{sys.executable} -m vtsdt ", piece, flags=re.MULTILINE)
            done = subprocess.run(
                ["sh", "-e", "-c", commands], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
            )
            assert done.returncode == 0, done.stderr
            assert "warning" not in done.stdout + done.stderr
        else:
            (tmp_path / re.findall(r"`([^`\n]+\.\w+)`", text)[-1]).write_text(piece)
    diagnosis = json.loads((tmp_path / "rig/diagnosis/diagnosis.json").read_text())
    truth = json.loads((tmp_path / "rig/truth.json").read_text())
    (found,), (hidden,) = diagnosis["effects"], truth["effects"]
    assert diagnosis["verdict"] == "effect found"
    assert (found["kind"], found["where"]) == (hidden["kind"], hidden["where"]) == ("coulomb_friction", "guide")


def test_the_unit_as_a_component_runs_as_the_page_has_it(tmp_path: Path) -> None:
    page = (ROOT / "docs/howto/fmu.md").read_text(encoding="utf-8")
    snippet = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)[-1]
    assert "Fmu(" in snippet
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    for command in (
        ["-m", "vtsdt", "export-fmu", "axis", "--out", "axis.fmu"],
        ["-c", f"{snippet}print(run.times[-1])"],
    ):
        done = subprocess.run(
            [sys.executable, *command], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
    assert float(done.stdout) == 1.0
