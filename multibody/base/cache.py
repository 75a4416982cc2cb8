"""The folder of generated sources and machine code: written once, never stale, never incomplete."""

from __future__ import annotations

import hashlib
import hmac
import os
import stat
import sys
import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

from multibody.base.cache_key import seal
from multibody.base.json_file import naming

__all__ = ["cache_dir", "digest_of", "kept_text", "read_object", "write_object", "write_once"]

_MARK = b"vtsdt object 2"
_GENERATING = ("declare", "equations", "model", "assembly", "compile")


def cache_dir() -> Path:
    """Return the folder of generated sources and compiled code, and create it.

    It is the environment variable ``VTSDT_CACHE`` if that is set, else the user's cache folder for ``vtsdt``.

    Raises
    ------
    OSError
        If it cannot be made or written to, or if somebody else can write into it: what lies there is run.
    """
    named = os.environ.get("VTSDT_CACHE")
    if named:
        folder = Path(named).expanduser()
    else:
        from platformdirs import user_cache_path

        folder = user_cache_path("vtsdt")
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        raise OSError(
            f"the cache folder '{folder}' cannot be made ({error}): set VTSDT_CACHE to a writable folder"
        ) from error
    if not os.access(folder, os.W_OK):
        raise OSError(f"the cache folder '{folder}' cannot be written to: set VTSDT_CACHE to a writable folder")
    _refuse_foreign(folder)
    return folder


def _refuse_foreign(folder: Path) -> None:
    """Refuse a folder into which another user could have put code, directly or by putting another in its place."""
    if not hasattr(os, "getuid"):  # elsewhere a user's folders are protected by access lists
        return
    real = folder.resolve()
    for path in (real, *real.parents):
        status = path.stat()
        others = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
        if path == real and status.st_uid != os.getuid():
            fault = "belongs to another user"
        elif others and (path == real or not status.st_mode & stat.S_ISVTX):
            fault = f"lies in '{path}', which others can write to" if path != real else "can be written to by others"
        else:
            continue
        raise OSError(
            f"the cache folder '{folder}' {fault}: compiled code from it is run, so take that right away with "
            f"'chmod go-w {path}', or set VTSDT_CACHE to a folder of your own"
        )


def digest_of(*texts: str) -> str:
    """Return 16 hexadecimal digits that change with the texts and with the borders between them."""
    digest = hashlib.sha256()
    for text in texts:
        digest.update(len(text).to_bytes(8, "little"))
        digest.update(text.encode())
    return digest.hexdigest()[:16]


def write_once(path: Path, text: str) -> None:
    """Put ``text`` at ``path`` unless it is there, for a user to read and to step through: it is not run from there."""
    if path.exists() and path.read_bytes() == text.encode():
        return
    _replace(path, text.encode())


def read_object(path: Path) -> tuple[bytes, str] | None:
    """Return object code and its note, or None where there is none that this user's program has written whole."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    mark, _, rest = content.partition(b"\n")
    given, _, rest = rest.partition(b"\n")
    if mark != _MARK or not hmac.compare_digest(seal(path.name, rest).encode(), given):
        return None
    note, _, code = rest.partition(b"\n")
    return code, note.decode()


def write_object(path: Path, code: bytes, note: str = "") -> None:
    """Keep object code with a note of one line and the user's seal; a reader never sees half of it."""
    rest = note.encode() + b"\n" + code
    _replace(path, b"\n".join((_MARK, seal(path.name, rest).encode(), rest)))


def _replace(path: Path, content: bytes) -> None:
    with naming(path):
        handle, draft = tempfile.mkstemp(dir=path.parent, prefix=path.stem, suffix=".tmp")
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(content)
            os.replace(draft, path)
        finally:
            Path(draft).unlink(missing_ok=True)


@lru_cache(maxsize=1)
def _generator() -> str:
    """What a generated text depends on besides its source: all that generates, and the Python that writes it."""
    home = Path(__file__).parents[1]
    files = (path for room in _GENERATING for path in sorted((home / room).rglob("*.py")))
    parts = (path.read_text(encoding="utf-8") for path in files)
    return digest_of(sys.version, *parts)


def kept_text(stem: str, source: tuple[str, ...], write: Callable[[], str]) -> str:
    """Return a generated text: the one kept from an earlier process, or newly written and kept.

    Parameters
    ----------
    stem : str
        Beginning of the file's name.
    source : tuple of str
        Everything that the text follows from besides the package's own modules.
    write : callable
        Returns the text.
    """
    path = cache_dir() / f"{stem}_{digest_of(_generator(), *source)}.txt"
    kept = read_object(path)
    if kept is not None:
        return kept[0].decode()
    text = write()
    write_object(path, text.encode())
    return text
