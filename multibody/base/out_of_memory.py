"""Whether an error comes of memory that a process asked for and did not get."""

from __future__ import annotations

import errno
from pathlib import Path

from multibody.base.memory_of_process import address_space_limit

__all__ = ["memory_used_up"]

#: Bytes below a limited address space from which on it counts as used up: libraries ask for pieces of up to this size.
MARGIN = 256 << 20


def memory_used_up(error: BaseException) -> bool:
    """Tell whether an error comes of memory that the process asked for and did not get, itself or by its causes.

    Libraries in C say so in many ways, or fail with another error where they do not look.  So where the address space
    is limited (``ulimit -v``) and most of it was in use, any error that nobody foresaw is taken for that.
    """
    if _says_so(error):
        return True
    if isinstance(error, OSError | ValueError):  # foreseen: the program's own messages are of these kinds
        return False
    limit = address_space_limit()
    if limit is None:
        return False
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii")
        peak = next((1024 * int(line.split()[1]) for line in status.splitlines() if line.startswith("VmPeak")), 0)
    except OSError:
        return False
    except MemoryError:  # not even for asking
        return True
    return peak > limit - MARGIN


def _says_so(error: BaseException | None) -> bool:
    if error is None:
        return False
    if isinstance(error, MemoryError) or getattr(error, "errno", None) == errno.ENOMEM:
        return True
    if isinstance(error, ImportError) and any(text in str(error) for text in ("failed to map", "allocate memory")):
        return True
    return _says_so(error.__cause__ or error.__context__)
