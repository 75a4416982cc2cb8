"""A search that was killed after it had added an effect gives, continued, the very files of an uninterrupted one."""

from __future__ import annotations

from pathlib import Path

import pytest
from broken_inputs import MODEL, STUDY, csv, rows, toml

from discrepancy.study import command
from discrepancy.study.history import save_history
from vtsdt.cli.command_line import main


class Killed(BaseException):
    """The process is gone."""


def files_below(folder: Path) -> list[Path]:
    return sorted(p.relative_to(folder) for p in folder.rglob("*") if p.is_file())


def test_a_search_killed_after_an_effect_was_added_ends_as_if_it_had_not_been(tmp_path: Path, monkeypatch) -> None:
    tables = {name: dict(table) for name, table in STUDY.items() if name not in ("initial", "offsets")}
    tables["outputs"] = {'"speed"': '"speed_m_per_s"'}
    tables["candidates"] = {"include": '["coulomb_friction@*"]'}
    for key in ("validate", "stop"):
        del tables["records"][key]
    (tmp_path / "study.toml").write_text(toml(tables))
    (tmp_path / "cart.py").write_text(MODEL)
    (tmp_path / "a.csv").write_text(csv(rows(1)))
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    words = ["diagnose", str(tmp_path / "study.toml"), "--quiet", "--out"]
    assert main([*words, str(whole)]) == 0

    def save_and_die(study, path):
        save_history(study, path)
        if study.accepted_stages:
            raise Killed

    monkeypatch.setattr(command, "save_history", save_and_die)
    with pytest.raises(Killed):
        main([*words, str(killed)])
    monkeypatch.undo()
    assert main([*words, str(killed), "--resume"]) == 0
    files = files_below(whole)
    assert Path("candidates_before.png") in files
    assert files_below(killed) == files
    for name in files:
        if name != Path("history.json"):  # a search that is continued is one step more
            assert (killed / name).read_bytes() == (whole / name).read_bytes(), name
