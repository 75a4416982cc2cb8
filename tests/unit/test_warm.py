"""The command that compiles the shipped models before they are needed."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from vtsdt.cli.command_line import main
from vtsdt.cli.warm import MODELS, REHEARSALS, shipped


def test_every_shipped_model_is_known_by_name_and_builds():
    for name in MODELS:
        assert shipped(name).components


def test_after_warming_another_process_compiles_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("VTSDT_CACHE", str(tmp_path))
    env = {**os.environ, "VTSDT_CACHE": str(tmp_path)}
    words = [sys.executable, "-m", "vtsdt", "warm", "axis"]
    output = subprocess.run(words, env=env, capture_output=True, text=True, check=True).stdout
    assert output.splitlines()[0].startswith("axis")
    assert str(tmp_path) in output
    code = (
        "from multibody.base.compile_events import on_compile; compiled = []; on_compile(lambda n, s: "
        "compiled.append(n)); from discrepancy.rigs.axis import build; s = build().build(); "
        "run = s.simulate(0.1, inputs={'reference.position': 0.1}); run[s.output_names[0]]; s.linearize(); "
        "print(compiled)"
    )
    assert (
        subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True).stdout
        == "[]\n"
    )


def test_an_unknown_model_is_refused_with_the_names(capsys):
    assert main(["warm", "elevator"]) == 2
    assert "take one of lift, lift-1d, lift-cabin, axis, gear" in capsys.readouterr().err


@pytest.mark.slow
def test_after_warming_align_compiles_nothing(tmp_path):
    """Empty and loaded, as the command is run on files."""
    from vtsdt.alignment.rehearsal import plain_trip
    from vtsdt.files.parameters import LiftParameters

    files = []
    for direction, load in ((1, 0.0), (-1, 0.0), (1, 2.0), (-1, 2.0)):
        trip = plain_trip(LiftParameters.bench(), direction, load)
        rows = zip(trip.time, trip.tension, trip.height, trip.acceleration, trip.time * 0.0 + load, strict=True)
        path = tmp_path / f"{len(files)}.csv"
        head = "time_s,tension_c_N,cabin_height_mm,cabin_acceleration_m_per_s2,payload_kg\n"
        path.write_text(head + "\n".join(f"{t:.4f},{f:.4f},{1e3 * z:.4f},{a:.5f},{m:g}" for t, f, z, a, m in rows))
        files.append(str(path))
    env = {**os.environ, "VTSDT_CACHE": str(tmp_path / "cache")}
    assert "align" in REHEARSALS
    subprocess.run([sys.executable, "-m", "vtsdt", "warm", "align", "--quiet"], env=env, check=True)
    for some in (files[:2], files[2:]):
        code = (
            "from multibody.base.compile_events import on_compile; compiled = []; on_compile(lambda n, s: "
            "compiled.append(n)); from vtsdt.cli.command_line import main; "
            f"main(['align', *{some!r}, '--out', {str(tmp_path / 'out')!r}, '--quiet']); "
            "print(compiled)"
        )
        done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True)
        assert done.stdout == "[]\n"


@pytest.mark.slow
def test_all_models_are_warmed(tmp_path, monkeypatch):
    monkeypatch.setenv("VTSDT_CACHE", str(tmp_path))
    assert main(["warm", "--quiet"]) == 0
