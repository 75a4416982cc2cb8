"""Names of modules in files of earlier versions."""

from __future__ import annotations

import importlib
import json
import warnings
from pathlib import Path

import pytest

from multibody import Model
from multibody.base.references import module_named

PACKAGES = ("multibody", "discrepancy", "vtsdt", "gearbox")
MOVED = [pair for package in PACKAGES for pair in importlib.import_module(package).MOVED.items()]


@pytest.mark.parametrize(("old", "new"), MOVED)
def test_an_old_name_gives_the_module_and_says_the_new_one(old: str, new: str) -> None:
    with pytest.warns(FutureWarning, match=f"'{old}' is now '{new}'"):
        module = module_named(old)
    assert module is importlib.import_module(new)


def test_a_present_name_does_not_warn() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert module_named("multibody.library").__name__ == "multibody.library"


def test_a_name_that_never_was_is_an_import_error() -> None:
    with pytest.raises(ImportError):
        module_named("vtsdt.no_such_module")


def test_a_model_saved_by_an_earlier_version_loads(tmp_path: Path) -> None:
    from vtsdt.parts.rope import DrivingPulley

    model = Model("old")
    model.add("pulley", DrivingPulley(J_p=0.1))
    path = model.save(tmp_path / "model.json")
    content = json.loads(path.read_text())
    content["components"]["pulley"]["class"] = "vtsdt.rope:DrivingPulley"
    path.write_text(json.dumps(content))
    with pytest.warns(FutureWarning, match="vtsdt.parts.rope"):
        assert type(Model.load(path).components["pulley"]) is DrivingPulley
