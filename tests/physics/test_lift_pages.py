"""The pages about the lift: the tutorial's code runs, the table of structures is what the command prints."""

from __future__ import annotations

import re
from pathlib import Path

import matplotlib.pyplot as plt

from vtsdt.lift.lift import Lift
from vtsdt.lift.structures import table_text

DOCS = Path(__file__).resolve().parents[2] / "docs"


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


def test_the_tutorial_runs(tmp_path, monkeypatch, capsys):
    page = DOCS / "tutorial" / "your-own-lift.md"
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lift.toml").write_text(blocks(page, "toml")[0], encoding="utf-8")
    names: dict[str, object] = {}
    for text in blocks(page, "python"):
        exec(compile(text, str(page), "exec"), names)
    plt.close("all")
    assert names["parameters"].cabin.mass == 45.0
    assert names["balance"].closure < 1e-6
    assert names["modes"].vertical().shape == (3, 5)
    assert {"diagram.png", "trip.png", "modes.png"} <= {p.name for p in tmp_path.iterdir()}
    assert capsys.readouterr().out.count("J") == 4


def test_the_table_of_structures_is_the_commands():
    assert table_text() in (DOCS / "reference" / "lift-structures.md").read_text(encoding="utf-8")


def test_the_parameter_tables_name_the_components_parameters():
    components = Lift.reference().components
    for page, owners in (("lift-guide.md", ["cabin_guide"]), ("lift-ropes.md", ["ropes", "pulley"])):
        text = (DOCS / "physics" / page).read_text(encoding="utf-8")
        for owner in owners:
            for name in components[owner].values:
                assert f"`{name}`" in text, f"{page} does not name {owner}.{name}"
