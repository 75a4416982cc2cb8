"""The secret of a user by which the program knows the compiled code that it has written itself."""

from __future__ import annotations

import hashlib
import hmac
import logging
import os
import secrets
import stat
import tempfile
from functools import lru_cache
from pathlib import Path

__all__ = ["seal"]

_LENGTH = 32  # bytes; as long as the digest, which is as long as such a key needs to be

_log = logging.getLogger(__name__)


def seal(name: str, content: bytes) -> str:
    """Return 64 hexadecimal digits that only this user can compute for a file's name and content (HMAC-SHA256).

    Raises
    ------
    OSError
        If the file of the secret can be read or written by others, or is damaged.
    """
    return hmac.new(_secret(), name.encode() + b"\0" + content, hashlib.sha256).hexdigest()


@lru_cache(maxsize=1)
def _secret() -> bytes:
    """Return the user's secret, made when it is first asked for.

    It lies in the user's data folder and not in the cache, so that it does not travel with a cache folder.
    """
    from platformdirs import user_data_path

    path = user_data_path("vtsdt") / "cache.key"
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        if not path.exists():
            _write_new(path)
        content = path.read_bytes()
    except OSError as error:
        _log.warning(
            "compiled code is used by this process only, because the key to recognise it later cannot be kept (%s): "
            "make '%s' a folder that you can write to",
            error,
            path.parent,
        )
        return secrets.token_bytes(_LENGTH)
    _refuse_foreign(path, content)
    return content


def _write_new(path: Path) -> None:
    handle, draft = tempfile.mkstemp(dir=path.parent, prefix=path.stem)  # readable by its owner only
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(secrets.token_bytes(_LENGTH))
        try:
            os.link(draft, path)  # fails where another process was first
        except FileExistsError:
            pass
        except OSError:  # a file system without links
            os.replace(draft, path)
    finally:
        Path(draft).unlink(missing_ok=True)


def _refuse_foreign(path: Path, content: bytes) -> None:
    status = path.stat()
    if hasattr(os, "getuid") and (status.st_uid != os.getuid() or status.st_mode & (stat.S_IRWXG | stat.S_IRWXO)):
        fault = "can be read or written by others"
    elif len(content) != _LENGTH:
        fault = f"is damaged: {len(content)} bytes long, not {_LENGTH}"
    else:
        return
    raise OSError(f"the key of compiled code '{path}' {fault}: delete it; a new one is made, and code compiled anew")
