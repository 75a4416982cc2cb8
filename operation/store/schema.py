"""The tables of a store.  A store of another version is refused; a column that is added gives a new version."""

from __future__ import annotations

__all__ = ["SCHEMA", "VERSION"]

VERSION = 1
SCHEMA = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT;
CREATE TABLE machines (
    id INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE
) STRICT;
CREATE TABLE records (            -- one row for each recording, judged or refused
    id INTEGER PRIMARY KEY,
    machine INTEGER NOT NULL REFERENCES machines (id),
    key TEXT NOT NULL,            -- digest of the content
    name TEXT NOT NULL,
    at REAL NOT NULL,             -- when it was recorded, s since 1970 (UTC)
    received REAL NOT NULL,       -- when it was judged
    duration REAL NOT NULL,       -- s
    refused TEXT NOT NULL,        -- why it could not be judged, or empty
    checks TEXT NOT NULL,         -- JSON, as "checks" in diagnosis.json
    series TEXT,                  -- its signals: file below series/, or NULL
    UNIQUE (machine, key)
) STRICT;
CREATE INDEX records_in_time ON records (machine, at);
CREATE TABLE quantities (         -- what a record says by itself
    record INTEGER NOT NULL REFERENCES records (id) ON DELETE CASCADE,
    name TEXT NOT NULL,
    kind TEXT NOT NULL,           -- parameter, misfit, virtual, feature, condition
    value REAL NOT NULL,
    std REAL,                     -- NULL: the record says nothing; 0: none to state
    unit TEXT NOT NULL,
    PRIMARY KEY (record, name)
) STRICT, WITHOUT ROWID;
CREATE TABLE events (             -- changes, alarms, named effects, notes of people
    id INTEGER PRIMARY KEY,
    machine INTEGER NOT NULL REFERENCES machines (id),
    kind TEXT NOT NULL,           -- change, alarm, named, note
    subject TEXT NOT NULL,        -- quantity, rule or effect
    at REAL NOT NULL,             -- when it began, s since 1970
    raised REAL NOT NULL,         -- time of the record that showed it
    detail TEXT NOT NULL,         -- JSON
    notified REAL,                -- when the notification was delivered
    UNIQUE (machine, kind, subject, raised)
) STRICT;
"""
