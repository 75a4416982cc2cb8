"""The files of one run as a unit: written beside, moved into place together, never mixed with those of another."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import shutil
import struct
import sys
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from html import escape
from pathlib import Path

from multibody.base.json_file import naming, write_json_atomically

__all__ = ["RUN", "FolderTaken", "check_owner", "written_together"]

RUN = "run.json"
"""File that says which run the others in the folder belong to, with the hash of each."""
_DRAFT, _READY = ".draft-", ".ready-"
_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_HEADER = len(_PNG) + 25  # bytes up to the end of the first chunk, after which texts may stand


class FolderTaken(OSError):
    """A folder holds the results of something else."""


def check_owner(out: Path, owner: str, subject: str) -> None:
    """Refuse a folder that holds the results of another kind of run, or of another subject.

    Parameters
    ----------
    out : Path
    owner : str
        Kind of run, such as ``"diagnosis"``.
    subject : str
        What it is of, such as the study's name.

    Raises
    ------
    FolderTaken
        With what the folder holds.
    """
    try:
        held = json.loads((out / RUN).read_text(encoding="utf-8"))
        kind, of = str(held["kind"]), str(held["subject"])
    except (OSError, ValueError, TypeError, KeyError):
        # earlier versions wrote no such file
        kind, of = ("diagnosis", subject) if (out / "diagnosis.json").exists() else (owner, subject)
    if (kind, of) != (owner, subject):
        raise FolderTaken(
            f"--out {out}: the folder holds the {kind} of '{of}', which the {owner} of '{subject}' would overwrite: "
            "name another folder"
        )


@contextmanager
def written_together(out: Path, owner: str, subject: str, run: str) -> Iterator[Path]:
    """Give a draft folder to write into; at the end its files are moved into place, and those of the last run go.

    Every JSON object, page and PNG picture gets the run written into it: ``"run"``, ``<meta name="vtsdt-run">`` and a
    text ``Run``.  If anything fails the folder is as before.  A process that ends while files are moved leaves what is
    still to be moved; the next run on the folder moves it first.  Of two processes one waits for the other.

    Parameters
    ----------
    out : Path
        Made if it is not there.
    owner, subject : str
        As of `check_owner`.
    run : str
        Identifies what was run: the same for the same model, records and settings.

    Raises
    ------
    FolderTaken
        If the folder holds the results of something else.
    OSError
        If something cannot be written; it names the folder.
    """
    with naming(out), _alone(out):
        _finish_earlier(out)
        check_owner(out, owner, subject)
        draft = out / f"{_DRAFT}{secrets.token_hex(4)}"
        draft.mkdir()
        try:
            yield draft
            for path in sorted(draft.rglob("*")):
                _stamp(path, run)
            files = {str(p.relative_to(draft).as_posix()): _digest(p) for p in sorted(draft.rglob("*")) if p.is_file()}
            write_json_atomically(
                draft / RUN, {"schema": 1, "run": run, "kind": owner, "subject": subject, "files": files}
            )
            ready = out / draft.name.replace(_DRAFT, _READY)
            os.replace(draft, ready)
        except BaseException:
            shutil.rmtree(draft, ignore_errors=True)
            raise
        _move(ready, out)


@contextmanager
def _alone(out: Path) -> Iterator[None]:
    """Make the folder, and wait until no other process writes into it; a lock ends with the process that holds it.

    Without this one of two processes would take the draft of the other for one that a killed process has left.
    """
    out.mkdir(parents=True, exist_ok=True)
    if sys.platform == "win32":  # has no lock on folders
        yield
        return
    import fcntl

    folder = os.open(out, os.O_RDONLY)
    try:
        with suppress(OSError):  # some network file systems have no locks
            fcntl.flock(folder, fcntl.LOCK_EX)
        yield
    finally:
        os.close(folder)


def _finish_earlier(out: Path) -> None:
    """Finish what a run that was killed has left: its files are complete where they are ready, else they go."""
    for ready in sorted(out.glob(f"{_READY}*")):
        _move(ready, out)
    for draft in out.glob(f"{_DRAFT}*"):
        shutil.rmtree(draft, ignore_errors=True)


def _move(ready: Path, out: Path) -> None:
    """Move the files of a finished run into place, its list of files last, and remove those that it replaces."""
    listed = ready / RUN
    if not listed.is_file():  # everything else has been moved already
        shutil.rmtree(ready, ignore_errors=True)
        return
    new = set(json.loads(listed.read_text(encoding="utf-8"))["files"])
    old: set[str] = set()
    with suppress(OSError, ValueError, TypeError, KeyError):
        old = set(json.loads((out / RUN).read_text(encoding="utf-8"))["files"])
    for name in sorted(new):
        if (ready / name).is_file():
            (out / name).parent.mkdir(parents=True, exist_ok=True)
            os.replace(ready / name, out / name)
    for name in old - new:
        path = out / name
        if path.resolve().is_relative_to(out.resolve()):
            path.unlink(missing_ok=True)
    os.replace(listed, out / RUN)
    shutil.rmtree(ready, ignore_errors=True)


def _stamp(path: Path, run: str) -> None:
    """Write the run into a file where its format has a place for it: JSON objects, pages and PNG pictures."""
    if not run or not path.is_file():
        return
    content = path.read_bytes()
    stamped = content
    if path.suffix == ".json" and content.lstrip()[:1] == b"{" and content.lstrip()[1:].lstrip()[:1] == b'"':
        before, _, after = content.partition(b"{")
        stamped = before + b'{\n "run": ' + json.dumps(run).encode() + b"," + after
    elif path.suffix == ".html":
        stamped = content.replace(b"<head>", f'<head>\n<meta name="vtsdt-run" content="{escape(run)}">'.encode(), 1)
    elif content[:8] == _PNG:
        text = b"tEXt" + b"Run\0" + run.encode("latin-1", "replace")
        chunk = struct.pack(">I", len(text) - 4) + text + struct.pack(">I", zlib.crc32(text))
        stamped = content[:_PNG_HEADER] + chunk + content[_PNG_HEADER:]
    if stamped != content:
        path.write_bytes(stamped)


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
