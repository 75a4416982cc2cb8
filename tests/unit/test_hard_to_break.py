"""Paths that are no files, rates out of all proportion, messages of any length: told briefly, with what to do."""

import os

import numpy as np
import pytest

from estimation.files.faults import RecordError
from estimation.files.read_records import read_records
from estimation.files.read_rules import ReadRules
from multibody.base.missing_file import why_no_file
from vtsdt.alignment.filter import DEFAULT, TUNINGS
from vtsdt.alignment.result import Alignment
from vtsdt.cli import command_line
from vtsdt.cli.command_line import main


def test_what_stands_where_a_file_should_be(tmp_path):
    (tmp_path / "a.csv").write_text("x")
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "link.csv").symlink_to(tmp_path / "gone.csv")
    assert why_no_file(tmp_path / "a.csv") == ""
    assert why_no_file(tmp_path / "folder") == "is a folder: name the file in it"
    assert why_no_file(tmp_path / "pipe.csv") == (
        "is a pipe or a device: write what it gives into a file and name that"
    )
    assert "gone.csv', which is not there: mend the link" in why_no_file(tmp_path / "link.csv")
    assert why_no_file(tmp_path / "b.csv") == "there is no such file; nearest: 'a.csv'"
    assert why_no_file(tmp_path / "none" / "b.csv") == (
        "there is no such file; its folder is missing or empty: name one that is there"
    )


def test_a_rate_out_of_all_proportion_is_refused_before_it_is_tried(tmp_path):
    time = np.arange(20) / 10.0
    text = "\n".join(["time_s,x_m", *(f"{t},{np.sin(t)}" for t in time)])
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(RecordError, match=r"1e\+15 Hz would make 1\.9e\+15 samples .* choose a rate near it"):
        read_records([tmp_path / "a.csv"], time="time_s", columns={"x": "x_m"}, rules=ReadRules(resample=1e15))


def test_a_message_has_an_end(capsys, monkeypatch):
    def fails(*arguments):
        raise OSError("\n".join(["x" * 10_000] * 500))

    monkeypatch.setattr(command_line, "_dispatch", fails)
    assert main(["diagnose"]) == 2
    told = capsys.readouterr().err
    assert len(told) < 150_000
    assert told.endswith("and more: --debug shows everything\n")


@pytest.mark.parametrize(("trips", "known"), [(1, False), (2, True)])
def test_one_trip_claims_no_certainty(trips, known):
    height = np.linspace(0.0, 10.0, 101)
    bump = 4e-3 * np.exp(-((height - 5.0) ** 2))
    curves = np.array([bump + 1e-5 * k for k in range(trips)])
    alignment = Alignment(
        height=height,
        curves=curves,
        trips=tuple(f"trip {k}" for k in range(trips)),
        directions=np.ones(trips, dtype=int),
        threshold=2e-3,
        tuning=TUNINGS[DEFAULT],
        tension_error=None,
        shoes=(0.0, 3.0),
        loose=1e-4,
        slope=1e5,
    )
    (section,) = alignment.sections
    assert np.isfinite(section.confidence) == known
    assert (alignment.to_json()["sections"][0]["confidence"] is not None) == known


def test_one_time_of_day_does_not_make_a_signal_a_clock(tmp_path):
    lines = ["time_s,x_m", "0,12:30:00", *(f"{0.1 * k},{np.sin(0.1 * k)}" for k in range(1, 20))]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    with pytest.raises(RecordError, match=r"column 'x_m', lines 3, 4, .* is not a date written as the others"):
        read_records([tmp_path / "a.csv"], time="time_s", columns={"x": "x_m"})
