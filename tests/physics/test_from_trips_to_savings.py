"""From recordings to savings by the commands alone, at full size: bench, align, what-if."""

from __future__ import annotations

import json

import numpy as np
import pytest

from vtsdt.cli.command_line import main


@pytest.mark.slow
def test_trips_give_an_alignment_and_that_gives_what_correcting_it_would_bring(tmp_path):
    trips, aligned, judged = tmp_path / "trips", tmp_path / "aligned", tmp_path / "judged"
    bench = ["bench", "lift", "--express", "--rate", "1000", "--loads", "0", "--seed", "1", "--out", str(trips)]
    assert main([*bench, "--quiet"]) == 0
    files = sorted(map(str, trips.glob("*.csv.gz")))
    assert len(files) >= 10
    assert main(["align", *files, "--out", str(aligned), "--quiet"]) == 0
    alignment = json.loads((aligned / "alignment.json").read_text())
    assert alignment["sections"]
    assert alignment["observability"]["detectable"]

    profile = str(aligned / "profile.csv")
    assert main(["what-if", *files, "--profile", profile, "--out", str(judged), "--quiet"]) == 0
    study = json.loads((judged / "what-if.json").read_text())
    losses = np.array([[t["guide_loss_J"]["measured"], t["guide_loss_J"]["model"]] for t in study["trips"]])
    assert len(losses) == len(files)
    # The rail came from these trips' friction, so the model with it has to lose what they lost.
    assert np.abs(losses.mean(axis=0)[1] / losses.mean(axis=0)[0] - 1.0) < 0.1
    actions = study["actions"]
    assert actions["straightened"]["E_c"]["value"] < actions["original"]["E_c"]["value"]
    assert actions["straightened"]["saving"]["low"] > 0.0
    assert actions["both"]["eta_t"]["value"] > actions["straightened"]["eta_t"]["value"]
    for action in actions.values():
        for figure in ("E_c", "E_cw", "E_cb", "E_m", "eta_t"):
            assert action[figure]["low"] <= action[figure]["value"] <= action[figure]["high"]
    for page in (aligned / "report.html", judged / "report.html"):
        text = page.read_text(encoding="utf-8")
        assert "http://" not in text
        assert "https://" not in text
