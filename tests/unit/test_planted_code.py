"""Code that somebody else has put into the cache folder does not run: what lies there is known by the user's seal."""

from __future__ import annotations

import hashlib
import os
import pickle
import py_compile
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from multibody.base import cache_key
from multibody.base.cache import digest_of, read_object, write_object

TEXT = "def rhs(t, x, u, p, dx):\n    dx[0] = -FACTOR * x[0]\n"
MINE, OTHER = TEXT.replace("FACTOR", "1.0"), TEXT.replace("FACTOR", "2.0")

#: What numba and the package's own emitter make of a text, and how many functions were compiled for it.
PROGRAM = """
import numpy as np
from multibody.compile import native
made = []
native.on_compile(lambda name, seconds: seconds is not None and made.append(name))
text = {text!r}
by_numba = native.compile_rhs(native.load_source(text, "planted"))
made_of_text = native._by_emitter(text, "planted", "rhs", 4, 0), None
by_emitter = native.NativeFunction(name="rhs", python=None, arrays=4, compiled=True, _made=made_of_text)
values = [function(0.0, *np.ones((3, 1)), np.empty(1))[0] for function in (by_numba, by_emitter)]
print(*values, len(made))
"""


def run(text: str, cache: Path, user: Path) -> str:
    """Run the program as a user, who is known by a folder of his own for data."""
    env = {**os.environ, "VTSDT_CACHE": str(cache), "XDG_DATA_HOME": str(user)}
    done = subprocess.run([sys.executable, "-c", PROGRAM.format(text=text)], env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.fixture
def key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The key of a user who has none yet."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    cache_key._secret.cache_clear()
    yield tmp_path / "data" / "vtsdt" / "cache.key"
    cache_key._secret.cache_clear()


def test_code_compiled_by_another_user_is_compiled_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where it lies under the very name that the program looks for, and where compiled Python lies beside it."""
    mine, theirs, me, them = (tmp_path / name for name in ("mine", "theirs", "me", "them"))
    assert run(MINE, mine, me) == "-1.0 -1.0 2"
    assert run(OTHER, theirs, them) == "-2.0 -2.0 2"

    def plant(user: Path) -> None:
        """Put the others' code under the names of mine, sealed by a user."""
        for suffix in (".o", ".nbo"):
            (target,), (source,) = mine.glob(f"*{suffix}"), theirs.glob(f"*{suffix}")
            monkeypatch.setenv("XDG_DATA_HOME", str(them))
            cache_key._secret.cache_clear()
            content = read_object(source)
            assert content is not None
            code = content[0].replace(digest_of(OTHER).encode(), digest_of(MINE).encode())  # the name of the module
            monkeypatch.setenv("XDG_DATA_HOME", str(user))
            cache_key._secret.cache_clear()
            write_object(target, code, content[1])
        cache_key._secret.cache_clear()

    plant(me)
    assert run(MINE, mine, me) == "-2.0 -2.0 0"  # what would happen without a seal
    plant(them)
    (source,) = mine.glob("planted_*.py")
    stamp = source.stat()
    source.write_text(OTHER)
    os.utime(source, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    py_compile.compile(str(source), doraise=True)  # its text is as long, and as old, as that of mine
    source.write_text(MINE)
    os.utime(source, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    assert run(MINE, mine, me) == "-1.0 -1.0 2"


class Planted:
    """A value that makes a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[object, ...]:
        return Path.touch, (self.path,)


def test_no_pickle_is_read_that_was_not_written_by_this_user(tmp_path: Path) -> None:
    cache, sign = tmp_path / "cache", tmp_path / "run"
    assert run(MINE, cache, tmp_path / "me") == "-1.0 -1.0 2"
    rest = b"\n" + pickle.dumps(Planted(sign))
    (kept,) = cache.glob("*.nbo")
    for mark in (b"vtsdt object 1", b"vtsdt object 2"):
        kept.write_bytes(b"\n".join((mark, hashlib.sha256(rest).hexdigest().encode(), rest)))
        (cache / "__pycache__").mkdir(exist_ok=True)
        (source,) = cache.glob("planted_*.py")
        version = f"py{sys.version_info.major}{sys.version_info.minor}"
        (cache / "__pycache__" / f"{source.stem}.rhs-1.{version}.nbi").write_bytes(rest[1:])
        assert run(MINE, cache, tmp_path / "me") == "-1.0 -1.0 1"  # the emitter's is still good
    assert not sign.exists()


def test_key_is_made_once_and_readable_by_its_owner_only(key: Path, tmp_path: Path) -> None:
    write_object(tmp_path / "a.o", b"code", "note")
    first = key.read_bytes()
    assert key.stat().st_mode & 0o777 == 0o600
    cache_key._secret.cache_clear()
    assert read_object(tmp_path / "a.o") == (b"code", "note")
    assert key.read_bytes() == first
    os.rename(tmp_path / "a.o", tmp_path / "b.o")
    assert read_object(tmp_path / "b.o") is None


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="needs Unix permissions")
@pytest.mark.parametrize(
    ("mode", "content", "fault"),
    [(0o640, b"k" * 32, "can be read or written by others"), (0o600, b"", "is damaged: 0 bytes long")],
)
def test_a_key_that_is_no_secret_is_refused_with_the_remedy(key: Path, mode: int, content: bytes, fault: str) -> None:
    key.parent.mkdir(parents=True)
    key.write_bytes(content)
    key.chmod(mode)
    with pytest.raises(OSError, match=f"{key}' {fault}.*delete it"):
        cache_key.seal("a.o", b"")


def test_without_a_place_for_the_key_code_is_kept_for_the_process_and_said_so(
    key: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "data").write_text("")
    write_object(tmp_path / "a.o", b"code")
    assert read_object(tmp_path / "a.o") == (b"code", "")
    assert "make" in caplog.text
    assert str(key.parent) in caplog.text
    cache_key._secret.cache_clear()  # as another process
    assert read_object(tmp_path / "a.o") is None


def test_digest_changes_with_the_borders_between_texts() -> None:
    assert digest_of("ab", "c") != digest_of("a", "bc")
