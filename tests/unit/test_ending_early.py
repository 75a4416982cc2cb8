"""Commands that end early end in order; results of a run stay together; workers end with their parent."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from multibody import Model
from multibody.base import stopping
from multibody.base.json_file import naming, write_json_atomically
from multibody.base.result_folder import RUN, FolderTaken, check_owner, written_together
from multibody.base.stopping import Stopped, stoppable
from multibody.library import Mass, Spring
from vtsdt.cli.arguments import CommandError, time_limit
from vtsdt.cli.command_line import main
from vtsdt.cli.commands import Command

# -------------------------------------------------------------------- ending


@pytest.mark.parametrize(
    ("words", "send", "code", "says"),
    [
        (["--time-limit", "0.2"], None, 124, "the time limit of 0.2 s was reached: there is no result yet"),
        ([], signal.SIGTERM, 143, "ended by SIGTERM"),
        ([], signal.SIGINT, 130, "interrupted"),
    ],
)
def test_a_command_ends_with_its_reason(monkeypatch, capsys, words, send, code, says) -> None:
    def work(arguments: object) -> int:
        if send is not None:
            os.kill(os.getpid(), send)
        while True:
            time.sleep(0.01)

    monkeypatch.setattr(Command, "function", lambda command, name: work)
    before = [signal.getsignal(n) for n in (signal.SIGTERM, signal.SIGINT)]
    assert main(["diagnose", *words]) == code
    assert says in capsys.readouterr().err
    assert [signal.getsignal(n) for n in (signal.SIGTERM, signal.SIGINT)] == before
    stopping.raise_if_stopped()  # what comes afterwards may work again


def test_a_simulation_in_a_thread_ends_too(monkeypatch) -> None:
    model = Model("m")
    body, spring = model.add("body", Mass(m=1.0, position=1.0)), model.add("spring", Spring(stiffness=1.0))
    model.connect(spring.a, body.flange)
    model.connect(spring.b, model.ground)
    system = model.build()
    monkeypatch.setattr(stopping, "_reason", "ended by SIGTERM")
    with pytest.raises(Stopped, match="ended by SIGTERM"):
        system.simulate(1.0)


def _terminated() -> None:
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(1.0)


def test_a_second_signal_ends_at_once() -> None:
    with stoppable():
        with pytest.raises(Stopped):
            _terminated()
        with pytest.raises(KeyboardInterrupt) as error:
            _terminated()
        assert not isinstance(error.value, Stopped)


def test_the_time_limit_is_read_before_the_command() -> None:
    assert time_limit(["a", "--time-limit", "5", "b"]) == (["a", "b"], 5.0)
    assert time_limit(["a", "--time-limit=2.5"]) == (["a"], 2.5)
    assert time_limit(["a"]) == (["a"], None)
    for words in (["--time-limit"], ["--time-limit", "soon"], ["--time-limit=0"], ["--time-limit=nan"]):
        with pytest.raises(CommandError, match=r"--time-limit: .* give a number above zero of seconds"):
            time_limit(words)


PARENT = """
import os, time
from multibody.base.process_pool import process_pool

if __name__ == "__main__":
    pool = process_pool(2)
    futures = [pool.submit(time.sleep, 60.0 + k) for k in range(2)]
    while len(pool._processes) < 2 or not all(f.running() for f in futures):
        time.sleep(0.05)
    time.sleep(1.0)
    print(*pool._processes, flush=True)
    time.sleep(60.0)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="looks at /proc")
def test_workers_end_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    (tmp_path / "parent.py").write_text(PARENT)
    root = str(Path(__file__).parents[2])
    environment = {**os.environ, "PYTHONPATH": root}
    parent = subprocess.Popen([sys.executable, "parent.py"], cwd=tmp_path, stdout=subprocess.PIPE, env=environment)
    try:
        workers = [int(word) for word in parent.stdout.readline().split()]
    finally:
        parent.kill()
        parent.wait()
        parent.stdout.close()
    assert len(workers) == 2
    for _ in range(100):
        left = [w for w in workers if _lives(w)]
        if not left:
            break
        time.sleep(0.1)
    assert left == []


def test_no_pool_is_made_whose_workers_outlive_their_parent() -> None:
    root = Path(__file__).parents[2]
    packages = ("multibody", "estimation", "surrogate", "discrepancy", "operation", "vtsdt", "gearbox")
    made = [p for name in packages for p in (root / name).rglob("*.py") if "ProcessPoolExecutor(" in p.read_text()]
    assert [p.name for p in made] == ["process_pool.py"]


def _lives(process: int) -> bool:
    """Tell whether a process runs; one that has ended and was not waited for does not."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


# -------------------------------------------------------------------- results as a unit


def write(out: Path, owner: str, subject: str, run: str, files: dict[str, str]) -> None:
    with written_together(out, owner, subject, run) as draft:
        for name, text in files.items():
            (draft / name).parent.mkdir(exist_ok=True)
            (draft / name).write_text(text)


def content(out: Path) -> dict[str, str]:
    return {str(p.relative_to(out)): p.read_text() for p in sorted(out.rglob("*")) if p.is_file() and p.name != RUN}


def test_files_of_a_run_come_together_and_those_of_the_last_one_go(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write(out, "diagnosis", "axis", "1", {"a.json": "old", "stages/0.json": "old", "b.png": "old"})
    (out / "notes.txt").write_text("mine")
    write(out, "diagnosis", "axis", "2", {"a.json": "new", "stages/0.json": "new"})
    assert content(out) == {"a.json": "new", "notes.txt": "mine", "stages/0.json": "new"}
    listed = json.loads((out / RUN).read_text())
    assert (listed["run"], listed["kind"], listed["subject"]) == ("2", "diagnosis", "axis")
    assert set(listed["files"]) == {"a.json", "stages/0.json"}


def test_every_file_of_a_run_says_of_which(tmp_path: Path) -> None:
    from PIL import Image

    from multibody import Model
    from multibody.model.storage import save

    with written_together(tmp_path, "diagnosis", "axis", "4f") as draft:
        (draft / "a.json").write_text('{"b": 1}')
        (draft / "empty.json").write_text("{}")
        (draft / "list.json").write_text("[1]")
        (draft / "page.html").write_text("<html><head><title>t</title></head></html>")
        Image.new("RGB", (2, 2)).save(draft / "p.png")
        save(Model("axis"), draft / "model.json")
    assert json.loads((tmp_path / "a.json").read_text()) == {"run": "4f", "b": 1}
    assert [(tmp_path / n).read_text() for n in ("empty.json", "list.json")] == ["{}", "[1]"]
    assert '<head>\n<meta name="vtsdt-run" content="4f"><title>' in (tmp_path / "page.html").read_text()
    with Image.open(tmp_path / "p.png") as picture:
        picture.load()
        assert picture.text == {"Run": "4f"}
    assert Model.load(tmp_path / "model.json").name == "axis"
    listed = json.loads((tmp_path / RUN).read_text())["files"]
    assert listed["a.json"] == hashlib.sha256((tmp_path / "a.json").read_bytes()).hexdigest()


@pytest.mark.parametrize(("owner", "subject"), [("comparison", "axis"), ("diagnosis", "press")])
def test_results_of_something_else_are_not_overwritten(tmp_path: Path, owner: str, subject: str) -> None:
    write(tmp_path, "diagnosis", "axis", "1", {"a.json": "old"})
    before = content(tmp_path)
    with pytest.raises(FolderTaken, match=r"the folder holds the diagnosis of 'axis'.* name another folder"):
        write(tmp_path, owner, subject, "2", {"a.json": "new"})
    assert content(tmp_path) == before


def test_a_diagnosis_of_an_earlier_version_is_known(tmp_path: Path) -> None:
    (tmp_path / "diagnosis.json").write_text("{}")
    with pytest.raises(FolderTaken):
        check_owner(tmp_path, "comparison", "axis")
    check_owner(tmp_path, "diagnosis", "axis")


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt(), ValueError()])
def test_what_fails_leaves_the_old_results_whole(tmp_path: Path, error: BaseException) -> None:
    write(tmp_path, "diagnosis", "axis", "1", {"a.json": "old", "b.json": "old"})

    def fails() -> None:
        with written_together(tmp_path, "diagnosis", "axis", "2") as draft:
            (draft / "a.json").write_text("new")
            raise error

    with pytest.raises(type(error)) as raised:
        fails()
    assert content(tmp_path) == {"a.json": "old", "b.json": "old"}
    assert not list(tmp_path.glob(".*"))
    if isinstance(raised.value, OSError):
        assert raised.value.filename == str(tmp_path)


@pytest.mark.parametrize("moved", range(4))
def test_a_run_that_is_killed_while_files_are_moved_is_finished_by_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moved: int
) -> None:
    write(tmp_path, "diagnosis", "axis", "1", {"a.json": "old", "b.json": "old", "c.json": "old"})
    real, count = os.replace, [0]

    def replace(source, target):
        if Path(source).parent.name.startswith(".ready"):
            count[0] += 1
            if count[0] > moved:
                raise SystemExit("killed")
        real(source, target)

    monkeypatch.setattr(os, "replace", replace)
    with pytest.raises(SystemExit):
        write(tmp_path, "diagnosis", "axis", "2", {"a.json": "new", "b.json": "new", "d.json": "new"})
    monkeypatch.setattr(os, "replace", real)
    with pytest.raises(RuntimeError), written_together(tmp_path, "diagnosis", "axis", "3"):
        raise RuntimeError
    assert content(tmp_path) == {"a.json": "new", "b.json": "new", "d.json": "new"}
    assert json.loads((tmp_path / RUN).read_text())["run"] == "2"


def test_a_full_disk_is_told_with_the_name_of_the_file(tmp_path: Path, monkeypatch, capsys) -> None:
    def full(*arguments: object) -> int:
        with naming(tmp_path / "history.json"):
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Command, "function", lambda command, name: full)
    assert main(["diagnose"]) == 2
    assert "history.json: the disk is full: free some space" in capsys.readouterr().err
    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match=r"history\.json"):
        write_json_atomically(tmp_path / "results.json", {})
    assert not list(tmp_path.iterdir())
