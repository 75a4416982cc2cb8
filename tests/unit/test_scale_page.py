"""The page on growth with the size of a study is made of what was measured, and only what is missing is measured."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_the_page_has_the_slopes_of_kept_results(tmp_path: Path) -> None:
    keep, page = tmp_path / "kept.jsonl", tmp_path / "scale.md"
    costs = {1_000: (2.0, 0), 4_000: (8.0, 0), 10_000: (50.0, 2)}
    lines = [
        json.dumps(["rows", n, {"processor": s, "wall": 2 * s, "peak": 1e9, "code": code, "candidates": 31}])
        for n, (s, code) in costs.items()
    ]
    cost = {"processor": 60.0, "wall": 90.0, "peak": 1e9, "code": -signal.SIGXCPU, "candidates": 31, "limit": 60.0}
    lines.append(json.dumps(["rows", 30_000, {**cost, "commit": "abc1234"}]))
    keep.write_text("\n".join(lines) + "\n")
    words = ["--only", "rows", "--most", "30000", "--keep", str(keep), "--page", str(page)]
    done = subprocess.run(
        [sys.executable, str(ROOT / "benchmarks" / "scale.py"), *words], capture_output=True, text=True, cwd=ROOT
    )
    assert done.returncode == 1, done.stderr  # one of the runs had no result
    assert "| 1000 | 31 | 2 | 4 | 1.00 |  | 0 |" in page.read_text()
    assert "| 4000 | 31 | 8 | 16 | 1.00 | 1.00 | 0 |" in page.read_text()
    assert "| 10000 | 31 | 50 | 100 | 1.00 | 2.00 | 2 |" in page.read_text()
    assert "| 30000 | 31 | 60 | 90 | 1.00 |  | not ended in 1 min | abc1234 |" in page.read_text()
    assert len(keep.read_text().splitlines()) == 4
