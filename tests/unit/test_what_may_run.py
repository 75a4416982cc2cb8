"""What a file from elsewhere can run, unpack or send to a terminal: nothing that the user did not name."""

from __future__ import annotations

import gzip
import json
import os
import stat
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest

from discrepancy.problem.model import load_model
from discrepancy.problem.study_file import StudyError, read_study
from estimation.files import bounded
from estimation.files.faults import RecordError
from estimation.files.read_table import read_table
from estimation.files.table import TableRequest
from multibody import Model
from multibody.base import references
from multibody.base.cache import cache_dir
from multibody.base.errors import ModelError
from multibody.base.progress import ProgressLine
from multibody.base.units import UnitError, same_dimension
from vtsdt.cli.command_line import main

STUDY = """
[model]
build = "BUILD"
ARGUMENTS
[outputs]
position = "x"
[records]
time = "t"
identify = ["a.csv"]
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "study").mkdir()
    (tmp_path / "study/a.csv").write_text("t,x\n0,1\n1,2\n")
    return tmp_path / "study"


def refused(folder: Path, build: str, arguments: str = "") -> str:
    (folder / "study.toml").write_text(STUDY.replace("BUILD", build).replace("ARGUMENTS", arguments))
    with pytest.raises(StudyError) as error:
        load_model(read_study(folder / "study.toml"))
    return str(error.value)


@pytest.mark.parametrize(
    ("build", "says"),
    [
        ("os:system", "no module 'os' beside the study or offered by an installed package"),
        ("collections.abc:Callable", "no module 'collections.abc' beside the study"),
        (
            f"{Path(os.__file__).as_posix()}:system",
            "is not beside the study: a study runs only files of its own folder",
        ),
        ("../outside.py:build", "is not beside the study"),
        ("link.py:build", "is not beside the study"),
        ("vtsdt.cli.command_line:main", "'vtsdt.cli.command_line' has no models for studies; there are 'vtsdt.lift'"),
        ("gearbox.stage:np", "'gearbox.stage' has no 'np'"),
        ("gearbox.rig.encoders:Path", "it is no builder of that package"),
    ],
)
def test_a_study_alone_runs_nothing(folder: Path, build: str, says: str) -> None:
    (folder.parent / "outside.py").write_text("raise RuntimeError('this ran')\n")
    (folder / "link.py").symlink_to(folder.parent / "outside.py")
    message = refused(folder, build, f'arguments = {{ command = "touch {folder / "ran"}" }}')
    assert "[model] build" in message
    assert says in message
    assert not (folder / "ran").exists()


def test_a_package_beside_the_study_is_its_own(folder: Path) -> None:
    (folder / "machines_of_this_study").mkdir()
    (folder / "machines_of_this_study/press.py").write_text("def build():\n    return 'a press'\n")
    (folder / "study.toml").write_text(
        STUDY.replace("BUILD", "machines_of_this_study.press:build").replace("ARGUMENTS", "")
    )
    assert load_model(read_study(folder / "study.toml")) == "a press"


def test_a_module_of_the_same_name_that_is_imported_already_is_not_taken_for_the_studys(folder: Path) -> None:
    (folder / "colorsys.py").write_text("def hls_to_rgb():\n    return 'a model'\n")
    import colorsys  # noqa: F401

    assert "another module 'colorsys' is imported already" in refused(folder, "colorsys:hls_to_rgb")


def test_an_installed_package_offers_its_models(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("discrepancy.problem.model.offered_modules", lambda: ("fractions", "statistics"))
    (folder / "study.toml").write_text(
        STUDY.replace("BUILD", "fractions:Fraction").replace("ARGUMENTS", "arguments = { numerator = 3 }")
    )
    assert load_model(read_study(folder / "study.toml")) == 3
    assert "comes from 'fractions': it is no builder" in refused(folder, "statistics:Fraction")


@pytest.mark.parametrize("line", ["sys.exit(0)", "raise SystemExit('no')"])
def test_a_model_that_ends_the_program_is_an_error_of_the_study(folder: Path, line: str) -> None:
    (folder / "m.py").write_text(f"import sys\ndef build():\n    {line}\n")
    assert "m.py, line 3, in build: SystemExit" in refused(folder, "m.py:build")


def test_a_working_directory_that_a_model_changes_is_restored(folder: Path, tmp_path: Path) -> None:
    (folder / "m.py").write_text(f"import os\ndef build():\n    os.chdir({str(folder)!r})\n    return 'a model'\n")
    (folder / "study.toml").write_text(STUDY.replace("BUILD", "m.py:build").replace("ARGUMENTS", ""))
    before = os.getcwd()
    assert load_model(read_study(folder / "study.toml")) == "a model"
    assert os.getcwd() == before


def test_a_model_file_imports_no_module_that_nobody_offers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "unwanted_module_of_a_test.py").write_text("raise RuntimeError('this ran')\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    path = Model("m").save(tmp_path / "model.json")
    content = json.loads(Path(path or tmp_path / "model.json").read_text())
    content["components"] = {"a": {"class": "unwanted_module_of_a_test:A"}}
    (tmp_path / "model.json").write_text(json.dumps(content))
    with pytest.raises(ModelError, match="is not imported because a file names it: import it before"):
        Model.load(tmp_path / "model.json")
    assert "unwanted_module_of_a_test" not in sys.modules
    monkeypatch.setattr(references, "offered_modules", lambda group: ("unwanted_module_of_a_test",))
    with pytest.raises(ModelError, match="this ran"):
        Model.load(tmp_path / "model.json")


# -------------------------------------------------------------------- what is unpacked


def test_a_small_file_that_unpacks_to_gigabytes_is_refused_early(tmp_path: Path) -> None:
    packer = zlib.compressobj(9, wbits=31)
    rows = b"1,2\n" * (1 << 20)
    content = packer.compress(b"t,x\n") + b"".join(packer.compress(rows) for _ in range(40)) + packer.flush()
    (tmp_path / "bomb.csv.gz").write_bytes(content)
    with pytest.raises(RecordError, match=r"bomb.csv.gz: unpacks from 0.16\d* MB to more than 6[78].\d MB"):
        read_table(tmp_path / "bomb.csv.gz", TableRequest(columns=("t", "x")))


def test_a_parquet_file_is_refused_by_what_it_says_that_it_holds(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table({"t": np.zeros(1 << 23), "x": np.zeros(1 << 23)}), tmp_path / "b.parquet")
    with pytest.raises(RecordError, match=r"b.parquet: unpacks from .* MB to more than 134 MB"):
        read_table(tmp_path / "b.parquet", TableRequest(columns=("t", "x")))
    assert (
        len(read_table(tmp_path / "b.parquet", TableRequest(columns=("t",))).numbers["t"]) == 1 << 23
    )  # 67 MB are harmless


def test_a_recording_that_would_fill_the_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.csv").write_text("t,x\n" + "0.125,2.5\n" * 100)
    monkeypatch.setattr(bounded, "machine_memory", lambda: 4.0 * 2050.0)
    assert len(read_table(tmp_path / "a.csv", TableRequest(columns=("t",))).numbers["t"]) == 100
    monkeypatch.setattr(bounded, "machine_memory", lambda: 4.0 * 2000.0)
    with pytest.raises(RecordError, match="cut it into shorter recordings"):
        read_table(tmp_path / "a.csv", TableRequest(columns=("t",)))


def test_gzip_files_of_several_members_are_read_whole_and_cut_ones_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv.gz"
    path.write_bytes(gzip.compress(b"t,x\n1,2\n") + gzip.compress(b"2,3\n") + b"\0" * 5)
    assert read_table(path, TableRequest(columns=("x",))).numbers["x"].tolist() == [2.0, 3.0]
    path.write_bytes(path.read_bytes()[:-12])
    with pytest.raises(RecordError, match="damaged or cut off"):
        read_table(path, TableRequest(columns=("x",)))


@pytest.mark.parametrize(
    "unit", ["9**9**9 m/s", "9^9^9", "m**99", "(9)**9", "(2*9)**9", "m**(9**9)", "((m**9)**9)**9", "m" * 1000]
)
def test_a_unit_that_would_take_hours_is_unknown(unit: str) -> None:
    with pytest.raises(UnitError, match="unknown unit") as error:
        same_dimension(unit, "m")
    assert len(str(error.value)) < 250


@pytest.mark.parametrize("unit", ["m/s**2", "kg*m**2/(s**3*A**2)", "m**0.5", "m**(1/2)", "(m/s)**2", "m**-2", "m²"])
def test_units_of_this_field_are_known(unit: str) -> None:
    assert same_dimension(unit, unit + " ")


# -------------------------------------------------------------------- the cache and the terminal


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="folders are protected by access lists here")
def test_a_cache_that_others_can_write_to_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VTSDT_CACHE", str(tmp_path / "a/cache"))
    assert stat.S_IMODE(cache_dir().stat().st_mode) & 0o077 == 0
    for path in (tmp_path / "a/cache", tmp_path / "a"):
        path.chmod(0o777)
        with pytest.raises(OSError, match=f"'chmod go-w {path}'"):
            cache_dir()
        path.chmod(0o755)
    (tmp_path / "a").chmod(0o1777)  # as /tmp: others can add to it, and not take away
    assert cache_dir() == tmp_path / "a/cache"
    monkeypatch.setattr(os, "getuid", lambda: 4711)
    with pytest.raises(OSError, match="belongs to another user"):
        cache_dir()


def test_escapes_in_names_are_shown_as_text(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study.toml").write_text('["\\u001b[2J\\u202Emodel"]\nbuild = "m.py:build"\n')
    assert main(["compare", "study.toml", "--out", "o"]) == 2
    told = capsys.readouterr().err
    assert "[\\x1b[2J\\u202emodel]: there is no such table" in told
    assert "\x1b" not in told
    monkeypatch.setattr("multibody.base.progress.PATIENCE", -1.0)
    with ProgressLine() as progress:
        progress("record \x1b]0;title\x07")
    assert "record \\x1b]0;title\\x07" in capsys.readouterr().err
