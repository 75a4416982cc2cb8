"""The platform's C compiler, and what it makes of a unit's sources."""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from multibody.fmi.errors import FmuError

__all__ = ["binary_folder", "c_compiler", "compile_library"]

_SYSTEMS = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("windows", ".dll")}
_MACHINES = {"amd64": "x86_64", "arm64": "aarch64"}


def c_compiler() -> list[str] | None:
    """Return the command of the C compiler (``CC``, else ``cc``, ``gcc`` or ``clang``), None where there is none."""
    if given := os.environ.get("CC"):
        return shlex.split(given)
    compiler = next((path for name in ("cc", "gcc", "clang") if (path := shutil.which(name))), None)
    return [compiler] if compiler else None


def binary_folder(fmi_version: str) -> tuple[str, str]:
    """Return the folder of this platform's library below ``binaries``, and the ending of the library's name."""
    system, ending = _SYSTEMS.get(sys.platform, (sys.platform, ".so"))
    machine = platform.machine().lower()
    machine = _MACHINES.get(machine, machine)
    if fmi_version == "2.0":
        short = {"linux": "linux", "darwin": "darwin", "windows": "win"}.get(system, system)
        return f"{short}{'64' if sys.maxsize > 2**32 else '32'}", ending
    return f"{machine}-{system}", ending


def compile_library(compiler: list[str], source: Path, library: Path) -> None:
    """Compile one source file into a shared library.

    Raises
    ------
    FmuError
        With the compiler's message.
    """
    flags = ["-std=c99", "-O2", "-fPIC", "-shared", "-ffp-contract=off", "-Wall", "-Wextra"]
    command = [*compiler, *flags, "-o", str(library), str(source), "-lm"]
    result = subprocess.run(command, capture_output=True, text=True, check=False, cwd=source.parent)
    if result.returncode or not library.exists():
        raise FmuError(f"'{' '.join(compiler)}' cannot compile {source.name}:\n{result.stderr.strip()[:2000]}")
