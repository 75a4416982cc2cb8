"""The schema of study files: it takes every study of the project, and refuses what the reader refuses."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import jsonschema
import msgspec
import pytest

from discrepancy.problem import tables
from discrepancy.problem.schema import study_schema
from vtsdt.cli import main

ROOT = Path(__file__).resolve().parents[2]
VALIDATOR = jsonschema.Draft202012Validator(study_schema())
#: A whole study, as it stands in a page: the first table is the model's, and records are named.
BLOCK = re.compile(r"```toml\n((?:(?!```).)*?\[model\](?:(?!```).)*?\[records\].*?)```", re.DOTALL)


def studies() -> dict[str, str]:
    """Text of every study in examples and pages."""
    texts = {str(p.relative_to(ROOT)): p.read_text(encoding="utf-8") for p in (ROOT / "examples").glob("*/*.toml")}
    for page in (ROOT / "docs").rglob("*.md"):
        for k, text in enumerate(BLOCK.findall(page.read_text(encoding="utf-8"))):
            texts[f"{page.relative_to(ROOT)}:{k}"] = text
    return texts


STUDIES = studies()


def faults(text: str) -> list[str]:
    return [error.message for error in VALIDATOR.iter_errors(tomllib.loads(text))]


def test_the_schema_is_one():
    jsonschema.Draft202012Validator.check_schema(study_schema())
    assert len(STUDIES) > 6


@pytest.mark.parametrize("name", STUDIES)
def test_every_study_of_the_project_is_valid(name):
    assert faults(STUDIES[name]) == []


SOUND = """
[model]
build = "a.py:build"
[uncertain]
mass.m = { std = 5.0 }
"mass.k" = { value = 1.0, min = 0.0 }
[inputs]
"u" = { column = "u_V", interpolation = "hold" }
[outputs]
mass.position = "x_m"
[records]
time = "t"
identify = ["a.csv", ["b.csv", "c.csv"]]
[initial]
free = ["mass.position"]
mass.speed = { record = { "a*" = 0.0, "*" = "measured" } }
"""


def test_a_study_with_every_way_of_writing_is_valid():
    assert faults(SOUND) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("[uncertain]", "[uncertan]"),
        ('time = "t"', 'tme = "t"'),
        ("std = 5.0", 'std = "5"'),
        ("std = 5.0", "sdt = 5.0"),
        ('"hold"', '"step"'),
        ('identify = ["a.csv", ["b.csv", "c.csv"]]', ""),
        ("[records]", "[records]\ndecimate = 1.5"),
        ('"a*" = 0.0', '"a*" = true'),
        ('[outputs]\nmass.position = "x_m"\n', ""),
    ],
)
def test_what_the_reader_refuses_is_refused(old, new):
    assert old in SOUND
    assert faults(SOUND.replace(old, new, 1)) != []


def test_every_key_that_the_reader_knows_is_in_the_schema():
    definitions = study_schema()["$defs"]
    structs = [v for v in vars(tables).values() if isinstance(v, type) and issubclass(v, msgspec.Struct)]
    assert len(structs) > 7
    for struct in structs:
        assert set(definitions[struct.__name__]["properties"]) == {f.name for f in msgspec.structs.fields(struct)}


def test_the_command_prints_it(capsys):
    assert main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out) == study_schema()
