"""A sample of the corpus of broken inputs: none is accepted silently, none hangs or is a fault of the program."""

from __future__ import annotations

import pytest
from broken_inputs import Broken, corpus, judged, sound, write

from discrepancy.problem.problem import read_problem
from vtsdt.cli.command_line import main

#: One in so many inputs: prime, so that the sample does not follow the order of the variants.
EVERY = 17


def sample() -> list[Broken]:
    return corpus()[::EVERY]


def test_the_corpus_is_as_wide_as_it_says() -> None:
    everything = corpus()
    assert len(everything) > 1000
    assert len({b.kind for b in everything}) > 200
    assert len({(b.kind, b.variant) for b in everything}) == len(everything)


def test_the_study_without_a_fault_is_accepted(tmp_path) -> None:
    assert len(read_problem(write(Broken("sound", "", {}), tmp_path)).identify) == 1
    assert set(sound()) == {p.name for p in tmp_path.iterdir() if p.is_file()}


@pytest.mark.parametrize("broken", sample(), ids=lambda b: f"{b.kind} {b.variant}")
def test_a_broken_input_is_refused_in_clear_words(broken: Broken, tmp_path, capsys, monkeypatch) -> None:
    study = write(broken, tmp_path)
    monkeypatch.chdir(tmp_path)
    code = main(["compare", str(study), "--out", str(tmp_path / "out"), "--quiet", *broken.words])
    assert judged(broken, code, capsys.readouterr().err) == "clear"


def test_the_rule_tells_what_is_not_clear() -> None:
    broken = Broken("k", "v", {}, ("force_N",))
    assert judged(broken, 0, "") == "silent"
    assert judged(broken, 1, "vtsdt: a fault in the program: ValueError") == "fault"
    assert judged(broken, 2, "vtsdt: a.csv, column 'force_N': wrong") == "vague"
    assert judged(broken, 2, "vtsdt: column 'force_N': write numbers only") == "vague"
    assert judged(broken, 2, "vtsdt: a.csv: write numbers only") == "vague"
    assert judged(broken, 2, "vtsdt: a.csv, column 'force_N': write numbers only") == "clear"
