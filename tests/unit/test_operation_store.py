"""The store: a record once, whole or not at all; several processes; killed at any moment."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from operation.store.judgement import Judgement, Quantity
from operation.store.store import Event, Store, StoreError

ROOT = Path(__file__).resolve().parents[2]
WRITER = """
import sys, pandas, numpy
from operation.store.store import Store
from operation.store.judgement import Judgement, Quantity
folder, first, count = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
with Store(folder) as store:
    print("ready", flush=True)
    for k in range(first, first + count):
        quantities = {f"q{j}": Quantity(value=float(k + j), std=1.0, kind="parameter") for j in range(20)}
        series = pandas.DataFrame({"t": numpy.arange(500.0), "y": numpy.full(500, float(k))})
        store.add("m", Judgement(key=f"{k:032d}", name=f"{k}", at=float(k), quantities=quantities), series)
        print(k, flush=True)
"""


def writer(folder: Path, first: int, count: int) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", WRITER, str(folder), str(first), str(count)]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)


def judgement(key: str = "a", at: float = 0.0, **values: float) -> Judgement:
    quantities = {n: Quantity(value=v, std=0.1, unit="N", kind="parameter") for n, v in values.items()}
    return Judgement(key=key, name=f"{key}.csv", at=at, quantities=quantities, checks={"y": {"size": 1.0}})


def test_what_is_written_is_read(tmp_path: Path) -> None:
    series = pd.DataFrame({"t": np.arange(3.0), "y": [1.0, np.nan, 2.0]})
    with Store(tmp_path) as store:
        assert store.add("lift", judgement("b", at=20.0, friction=8.0))
        assert store.add("lift", judgement("a", at=10.0, friction=7.0), series)
        assert not store.add("lift", judgement("a", at=99.0))
        assert store.add("other", judgement("a", at=10.0, friction=1.0))
        nothing = Quantity(value=1.0, std=np.inf, kind="parameter")
        store.add("other", Judgement(key="c", name="c", at=1.0, quantities={"x": nothing}, refused="too short"))
    with Store(tmp_path, create=False) as store:
        first, second = store.judgements("lift")
        assert (first.key, first.at, first.quantities["friction"].value) == ("a", 10.0, 7.0)
        assert second.checks == {"y": {"size": 1.0}}
        assert store.judgements("other")[0].quantities["x"].std == np.inf
        assert store.judgements("other")[0].refused == "too short"
        assert store.machines == ("lift", "other")
        kept = store.series("lift", "a")
        assert kept is not None
        pd.testing.assert_frame_equal(kept, series)
        assert store.series("lift", "b") is None
        frame = store.to_frame(["lift"])
        assert frame["value"].tolist() == [7.0, 8.0]
        assert str(frame["at"].dt.tz) == "UTC"


def test_an_event_is_kept_once(tmp_path: Path) -> None:
    event = Event(kind="change", subject="friction", at=3.0, raised=5.0, detail={"size": 1.5})
    with Store(tmp_path) as store:
        assert store.add_event("m", event)
        assert not store.add_event("m", event)
        store.mark_notified("m", event)
        store.note("m", "shoe replaced", 6.0, new_reference=True)
        changes, notes = store.events("m", "change"), store.events("m", "note")
        assert [e.detail for e in changes] == [{"size": 1.5}]
        assert changes[0].notified is not None
        assert notes[0].detail == {"new_reference": True}
        assert store.events("other") == ()


def test_retention_counts_from_the_latest_record_and_removes_files(tmp_path: Path) -> None:
    series = pd.DataFrame({"t": [0.0]})
    with Store(tmp_path) as store:
        for k in range(4):
            store.add("m", judgement(f"{k}" * 32, at=100.0 * k, x=float(k)), series)
        assert len(list((tmp_path / "series").iterdir())) == 4
        assert store.retain(series=150.0) == 2
        assert len(list((tmp_path / "series").iterdir())) == 2
        assert len(store.judgements("m")) == 4
        assert store.retain(records=150.0) == 2
        assert [j.at for j in store.judgements("m")] == [200.0, 300.0]
        assert store.to_frame()["value"].tolist() == [2.0, 3.0]


def test_a_record_of_the_future_makes_none_forgotten(tmp_path: Path) -> None:
    """Kept by an earlier version, or while the computer's own clock was ahead."""
    now = time.time()
    with Store(tmp_path) as store:
        for k, at in enumerate((now - 100.0, now - 50.0, now + 4e8)):
            store.add("m", judgement(f"{k}" * 32, at=at, x=1.0))
        assert store.retain(records=1000.0) == 0
        assert len(store.judgements("m")) == 3


def test_what_is_no_store_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="there is no history"):
        Store(tmp_path / "nothing", create=False)
    (tmp_path / "text").mkdir()
    (tmp_path / "text" / "history.sqlite").write_text("not a database at all, but long enough to be read" * 50)
    with pytest.raises(StoreError, match="damaged"):
        Store(tmp_path / "text")
    with Store(tmp_path / "new"):
        pass
    with sqlite3.connect(tmp_path / "new" / "history.sqlite") as db:
        db.execute("UPDATE meta SET value = '99'")
    db.close()
    with pytest.raises(StoreError, match="version 99"):
        Store(tmp_path / "new")
    (tmp_path / "foreign").mkdir()
    with sqlite3.connect(tmp_path / "foreign" / "history.sqlite") as db:
        db.execute("CREATE TABLE t (x)")
    db.close()
    with pytest.raises(StoreError, match="another program"):
        Store(tmp_path / "foreign")


def test_two_processes_write_and_one_is_killed_again_and_again(tmp_path: Path) -> None:
    """After each kill every record that was reported is there whole, and at most the one in work is not."""
    rng, first = np.random.default_rng(0), 0
    with Store(tmp_path):
        pass
    other = writer(tmp_path, 1_000_000, 60)
    for _ in range(4):
        process = writer(tmp_path, first, 10_000)
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        reported = [int(process.stdout.readline()) for _ in range(rng.integers(1, 12))]
        time.sleep(float(rng.uniform(0.0, 0.03)))  # a record takes about as long: any moment of its writing
        os.kill(process.pid, signal.SIGKILL)
        reported += [int(line) for line in process.stdout.read().split("\n")[:-1] if line.strip().isdigit()]
        process.wait()
        process.stdout.close()
        with Store(tmp_path) as store:
            mine = [j for j in store.judgements("m") if j.at < 1_000_000]
        kept = [int(j.key) for j in mine]
        last = reported[-1]
        assert kept == list(range(len(kept)))
        assert last <= len(kept) - 1 <= last + 1  # a record may be committed and not yet reported
        assert all(len(j.quantities) == 20 for j in mine)
        first = len(kept)
    out, _ = other.communicate(timeout=60)
    assert out.split()[-1] == str(1_000_059)
    with Store(tmp_path) as store:
        assert len(store.judgements("m")) == first + 60
        for j in store.judgements("m"):
            frame = store.series("m", j.key)
            assert frame is not None
            assert frame["y"].iloc[-1] == float(j.key)
        named = len(store.judgements("m"))
        store.tidy(age=0.0)
        assert len(list((tmp_path / "series").iterdir())) == named
    assert first > 0
