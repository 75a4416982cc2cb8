"""The page on real machines shows what each diagnosis says, and a study in the file of results is not run again."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_the_page_has_the_names_probabilities_and_errors_of_a_kept_diagnosis(tmp_path: Path) -> None:
    keep, page = tmp_path / "kept.jsonl", tmp_path / "page.md"
    names = [("coulomb_friction", 0.7), ("hysteresis", 0.25)]
    found, other = ({"kind": kind, "where": "pivot", "probability": p} for kind, p in names)
    strengths = {"coulomb": {"value": 5e-4, "std": 1e-5, "unit": "N*m"}}
    figures = [{"rod.angle": {"rmse": rmse, "nrmse": 10.0 * rmse}} for rmse in (0.5, 0.012, 0.003)]
    checks = [("size", 0.8, 0.1, True), ("whiteness", 0.5, 9.0, False)]
    said = {
        "verdict": "effect found",
        "sentence": "The model lacks one effect.",
        "effects": [{**found, "parameters": strengths, "indistinguishable_from": []}],
        "stages": [{"name": str(k), "validate": of} for k, of in enumerate(figures)],
        "explained_on": "validate",
        "probabilities": {
            "nothing": 0.0,
            "effects": [{**found, "set": [found, other]}],
            "models": [{"effects": ["coulomb_friction@pivot"], "probability": 0.7}],
        },
        "predictive_gain": {"coulomb_friction@pivot": {"gain": 80.4, "standard_error": 9.6}},
        "predictive_checks": [
            {"output": "rod.angle", "what": what, "value": v, "deviations": d, "passed": ok}
            for what, v, d, ok in checks
        ],
        "checks": {"rod.angle": {"fit_percent": 97.0, "innovation_white": False, "size": 0.8, "even": True}},
        "units": {"rod.angle": "rad"},
    }
    run = {"processor": 41.7, "wall": 60.0, "code": 0, "commit": "abc1234", "date": "2026-01-02", "diagnosis": said}
    keep.write_text(json.dumps(["pendulum/small_swings", run]) + "\n")
    words = ["--only", "pendulum/small_swings", "--keep", str(keep), "--page", str(page)]
    done = subprocess.run(
        [sys.executable, str(ROOT / "benchmarks" / "real_machines.py"), *words],
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    assert done.returncode == 0, done.stderr
    text = page.read_text()
    assert "effect found | dry (Coulomb) friction at pivot, 70 % | rod.angle 12.0 mrad → 3.00 mrad (12 → 3 %)" in text
    assert "| 1 of 2 | 42 s |" in text
    assert "coulomb 500 µN·m ± 10.0 µN·m | friction with " in text
    assert "at pivot, 25 % | 80 ± 10 |" in text
    assert "most: rod.angle, whiteness: 9.0 standard deviations off." in text
    assert "| 97.0 % | not white, 0.80 of the size promised, even |" in text
    assert len(keep.read_text().splitlines()) == 1
