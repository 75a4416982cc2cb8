"""A store on the disk: transactions in SQLite, signals in Parquet; several processes may use it at once.

A record is one transaction.  Its signals are written first, flushed to the disk and moved to their name; then the
transaction that names them is committed.  So a power cut between any two writes loses at most the record in work, and
leaves at most a file of signals that no row names, which `Store.tidy` removes.
"""

from __future__ import annotations

import json
import math
import os
import sqlite3
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from multibody.base.json_file import naming
from multibody.base.quantity_text import count_text
from operation.store.judgement import Judgement, Quantity
from operation.store.schema import SCHEMA, VERSION

if TYPE_CHECKING:
    import pandas

__all__ = ["Event", "Store", "StoreError"]

#: Seconds that a writer waits for another process.
PATIENCE = 60.0
#: Age of a file of signals without a row from which no writer can still be about to name it, s.
ORPHAN_AGE = 3600.0
NAME = "history.sqlite"


class StoreError(ValueError):
    """A store cannot be used; the message names the folder and the remedy."""


@dataclass(frozen=True, kw_only=True)
class Event:
    """Something that happened to a machine.

    Parameters
    ----------
    kind : {"change", "alarm", "named", "note"}
    subject : str
        Quantity, rule or effect.
    at : float, s
        When it began, in seconds since 1970.
    raised : float, s
        Time of the record that showed it.
    detail : mapping
        JSON values.
    notified : float or None
        When the notification was delivered.
    machine : str
    """

    kind: str
    subject: str
    at: float
    raised: float
    detail: Mapping[str, Any]
    notified: float | None = None
    machine: str = ""


class Store:
    """The history of one machine or a fleet, in a folder.

    Parameters
    ----------
    folder : str or Path
    create : bool
        Make the store if there is none.

    Raises
    ------
    StoreError
        If there is none, or it is of another version.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder, Store(folder) as store:
    ...     friction = Quantity(value=7.0, std=0.2, unit="N", kind="parameter")
    ...     store.add("lift 1", Judgement(key="a", name="a.csv", at=0.0, quantities={"friction": friction}))
    ...     store.add("lift 1", Judgement(key="a", name="copy of a.csv", at=0.0))
    ...     store.to_frame()[["machine", "name", "quantity", "value"]].values.tolist()
    True
    False
    [['lift 1', 'a.csv', 'friction', 7.0]]
    """

    def __init__(self, folder: str | Path, *, create: bool = True):
        self.folder = Path(folder)
        path = self.folder / NAME
        if not path.is_file() and not create:
            raise StoreError(f"{self.folder}: there is no history ({NAME}): name the folder that `vtsdt follow` fills")
        self.folder.mkdir(parents=True, exist_ok=True)
        (self.folder / "series").mkdir(exist_ok=True)
        self._db = sqlite3.connect(path, timeout=PATIENCE, isolation_level=None)
        try:
            self._prepare()
        except sqlite3.DatabaseError as error:
            self._db.close()
            raise StoreError(
                f"{path}: {error}: this is no history, or it is damaged: restore it from a copy, or begin a new folder"
            ) from error
        except BaseException:
            self._db.close()
            raise

    def _prepare(self) -> None:
        self._db.execute("PRAGMA journal_mode = WAL")
        self._db.execute("PRAGMA synchronous = FULL")  # a committed record survives a power cut
        self._db.execute("PRAGMA foreign_keys = ON")
        with self._transaction():
            tables = {row[0] for row in self._db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
            if not tables:
                for statement in SCHEMA.split(";\n"):
                    if statement.strip():
                        self._db.execute(statement)
                self._db.execute("INSERT INTO meta VALUES ('version', ?)", (str(VERSION),))
        if tables and "meta" not in tables:
            raise StoreError(f"{self.folder / NAME}: is the database of another program: name another folder")
        version = self._db.execute("SELECT value FROM meta WHERE key = 'version'").fetchone()[0]
        if version != str(VERSION):
            raise StoreError(
                f"{self.folder}: the history is of version {version}, this program writes version {VERSION}: use the "
                "program that wrote it, or begin a new folder"
            )

    # ---------------------------------------------------------------- life

    def close(self) -> None:
        """Close the store."""
        self._db.close()

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._db.execute("BEGIN IMMEDIATE")
        try:
            yield
        except BaseException:
            self._db.execute("ROLLBACK")
            raise
        self._db.execute("COMMIT")

    # ---------------------------------------------------------------- writing

    def add(self, machine: str, judgement: Judgement, series: pandas.DataFrame | None = None) -> bool:
        """Keep a judged record; False if its content is there already.

        Parameters
        ----------
        machine : str
        judgement : Judgement
        series : DataFrame, optional
            Its signals.
        """
        if self.known(machine, judgement.key):
            return False
        file = self._write_series(machine, judgement.key, series) if series is not None else None
        with self._transaction():
            owner = self._machine(machine)
            done = self._db.execute(
                "INSERT OR IGNORE INTO records (machine, key, name, at, received, duration, refused, checks, series) "
                "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
                (
                    owner,
                    judgement.key,
                    judgement.name,
                    float(judgement.at),
                    time.time(),
                    float(judgement.duration),
                    judgement.refused,
                    json.dumps(judgement.checks),
                    file,
                ),
            )
            if done.rowcount == 0:  # another process was faster
                return False
            rows = [
                (done.lastrowid, name, q.kind, float(q.value), float(q.std) if math.isfinite(q.std) else None, q.unit)
                for name, q in judgement.quantities.items()
                if math.isfinite(q.value)
            ]
            self._db.executemany("INSERT INTO quantities VALUES (?, ?, ?, ?, ?, ?)", rows)
        return True

    def _write_series(self, machine: str, key: str, series: pandas.DataFrame) -> str:
        folder = self.folder / "series"
        path = folder / f"{_safe(machine)}-{key[:32]}.parquet"
        with naming(path):
            handle, draft = tempfile.mkstemp(dir=folder, prefix=path.name, suffix=".tmp")
            os.close(handle)
            try:
                series.to_parquet(draft, compression="zstd", index=False)
                with open(draft, "rb+") as stream:
                    os.fsync(stream.fileno())
                os.replace(draft, path)
            finally:
                Path(draft).unlink(missing_ok=True)
        return path.name

    def _machine(self, name: str) -> int:
        self._db.execute("INSERT OR IGNORE INTO machines (name) VALUES (?)", (name,))
        return int(self._db.execute("SELECT id FROM machines WHERE name = ?", (name,)).fetchone()[0])

    def add_event(self, machine: str, event: Event) -> bool:
        """Keep an event; False if it is there already."""
        with self._transaction():
            done = self._db.execute(
                "INSERT OR IGNORE INTO events (machine, kind, subject, at, raised, detail, notified) "
                "VALUES (?, ?, ?, ?, ?, ?, ?)",
                (
                    self._machine(machine),
                    event.kind,
                    event.subject,
                    float(event.at),
                    float(event.raised),
                    json.dumps(event.detail),
                    event.notified,
                ),
            )
        return done.rowcount > 0

    def mark_notified(self, machine: str, event: Event) -> None:
        """Keep that an event's notification was delivered."""
        with self._transaction():
            self._db.execute(
                "UPDATE events SET notified = ? WHERE kind = ? AND subject = ? AND raised = ? AND machine = "
                "(SELECT id FROM machines WHERE name = ?)",
                (time.time(), event.kind, event.subject, float(event.raised), machine),
            )

    def note(self, machine: str, text: str, at: float, *, new_reference: bool = False) -> None:
        """Keep what was done to a machine.

        Parameters
        ----------
        machine : str
        text : str
        at : float, s
            Since 1970.
        new_reference : bool
            True where the machine is another one since: later records are compared with each other only.
        """
        self.add_event(
            machine,
            Event(kind="note", subject=text, at=at, raised=time.time(), detail={"new_reference": new_reference}),
        )

    def retain(self, *, series: float | None = None, records: float | None = None, now: float | None = None) -> int:
        """Forget what is older than a time, and return how many records lost their signals or themselves.

        Parameters
        ----------
        series, records : float, s, optional
            Age from which the signals, and the records with all they gave, are forgotten; default: never.
        now : float, s, optional
            Default: the latest record of each machine or the computer's time, whichever is earlier, so that no clock
            that jumps makes records forgotten.
        """
        gone = 0
        for machine in self.machines:
            owner = self._db.execute("SELECT id FROM machines WHERE name = ?", (machine,)).fetchone()[0]
            last = self._db.execute("SELECT MAX(at) FROM records WHERE machine = ?", (owner,)).fetchone()[0]
            if last is None:
                continue
            until = min(last, time.time()) if now is None else now
            with self._transaction():
                if records is not None:
                    done = self._db.execute(
                        "DELETE FROM records WHERE machine = ? AND at < ?", (owner, until - records)
                    )
                    gone += done.rowcount
                if series is not None:
                    done = self._db.execute(
                        "UPDATE records SET series = NULL WHERE machine = ? AND at < ? AND series IS NOT NULL",
                        (owner, until - series),
                    )
                    gone += done.rowcount
        self.tidy(age=0.0 if gone else ORPHAN_AGE)
        return gone

    def tidy(self, age: float = ORPHAN_AGE) -> int:
        """Remove files of signals that no record names, and return how many.

        Parameters
        ----------
        age : float, s
            Only those that are older, because another process may be about to name a younger one.
        """
        named = {row[0] for row in self._db.execute("SELECT series FROM records WHERE series IS NOT NULL")}
        count = 0
        for path in sorted((self.folder / "series").iterdir()):
            if path.name not in named and time.time() - path.stat().st_mtime >= age:
                path.unlink(missing_ok=True)
                count += 1
        return count

    # ---------------------------------------------------------------- reading

    def known(self, machine: str, key: str) -> bool:
        """Return whether a record's content is there."""
        query = "SELECT 1 FROM records JOIN machines ON machines.id = machine WHERE machines.name = ? AND key = ?"
        return self._db.execute(query, (machine, key)).fetchone() is not None

    @property
    def machines(self) -> tuple[str, ...]:
        """Names of the machines."""
        return tuple(row[0] for row in self._db.execute("SELECT name FROM machines ORDER BY name"))

    def judgements(self, machine: str) -> tuple[Judgement, ...]:
        """Return the records of a machine in the order of their time, refused ones included."""
        query = (
            "SELECT records.id, key, records.name, at, duration, refused, checks FROM records "
            "JOIN machines ON machines.id = machine WHERE machines.name = ? ORDER BY at, records.id"
        )
        rows = self._db.execute(query, (machine,)).fetchall()
        given: dict[int, dict[str, Quantity]] = {row[0]: {} for row in rows}
        query = (
            "SELECT record, quantities.name, kind, value, std, unit FROM quantities "
            "JOIN records ON records.id = record JOIN machines ON machines.id = machine WHERE machines.name = ?"
        )
        for record, name, kind, value, std, unit in self._db.execute(query, (machine,)):
            if record in given:
                given[record][name] = Quantity(value=value, std=math.inf if std is None else std, unit=unit, kind=kind)
        return tuple(
            Judgement(
                key=key,
                name=name,
                at=at,
                duration=duration,
                quantities=given[number],
                checks=json.loads(checks),
                refused=refused,
            )
            for number, key, name, at, duration, refused, checks in rows
        )

    def events(self, machine: str | None = None, kind: str | None = None) -> tuple[Event, ...]:
        """Return events in the order in which they were shown."""
        query = (
            "SELECT kind, subject, at, raised, detail, notified, machines.name FROM events "
            "JOIN machines ON machines.id = machine WHERE (:machine IS NULL OR machines.name = :machine) "
            "AND (:kind IS NULL OR kind = :kind) ORDER BY raised, events.id"
        )
        wanted = {"machine": machine, "kind": kind}
        return tuple(
            Event(
                kind=one, subject=subject, at=at, raised=raised, detail=json.loads(detail), notified=done, machine=name
            )
            for one, subject, at, raised, detail, done, name in self._db.execute(query, wanted)
        )

    def series(self, machine: str, key: str) -> pandas.DataFrame | None:
        """Return the signals of a record; None where they were not kept or are forgotten."""
        import pandas

        query = "SELECT series FROM records JOIN machines ON machines.id = machine WHERE machines.name = ? AND key = ?"
        row = self._db.execute(query, (machine, key)).fetchone()
        if row is None or row[0] is None:
            return None
        return pandas.read_parquet(self.folder / "series" / row[0])

    def to_frame(self, machines: Sequence[str] | None = None) -> pandas.DataFrame:
        """Return every quantity of every record as a table, one row each, in the order of time.

        Columns are machine, name, at (UTC), quantity, kind, value, std and unit.
        """
        import pandas

        columns = ["machine", "name", "at", "quantity", "kind", "value", "std", "unit"]
        query = (
            "SELECT machines.name, records.name, at, quantities.name, kind, value, std, unit FROM quantities "
            "JOIN records ON records.id = record JOIN machines ON machines.id = machine "
            "ORDER BY machines.name, at, records.id, quantities.name"
        )
        frame = pandas.DataFrame(self._db.execute(query).fetchall(), columns=columns)
        frame["at"] = pandas.to_datetime(frame["at"], unit="s", utc=True)
        frame["std"] = frame["std"].astype(float).fillna(math.inf)
        return frame if machines is None else frame[frame["machine"].isin(list(machines))].reset_index(drop=True)

    def __repr__(self) -> str:
        count = self._db.execute("SELECT COUNT(*) FROM records").fetchone()[0]
        return (
            f"Store({str(self.folder)!r}: {count_text(len(self.machines), 'machine')}, {count_text(count, 'record')})"
        )


def _safe(name: str) -> str:
    """Return a machine's name as part of a file name."""
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in name)[:64]
