"""How much memory this process may have: that of the machine, of its address space, of its container."""

from __future__ import annotations

import os
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

__all__ = ["address_space_limit", "container_limit", "machine_memory"]

#: Bytes from which on a control group's limit is none: version 1 has the largest number of pages there.
NO_LIMIT = 1 << 60


def machine_memory() -> float:
    """Return how many bytes this process could have: those of the machine, or of a container or a resource limit."""
    try:
        sizes = [float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))]
    except (AttributeError, ValueError, OSError):  # not known everywhere
        sizes = [8.0 * 2**30]
    try:
        import resource
    except ImportError:  # not on Windows
        pass
    else:
        limits = (resource.getrlimit(kind)[0] for kind in (resource.RLIMIT_AS, resource.RLIMIT_DATA))
        sizes += [float(limit) for limit in limits if limit != resource.RLIM_INFINITY]
    container = container_limit()
    return min(sizes if container is None else [*sizes, float(container)])


def address_space_limit() -> int | None:
    """Return the limit of this process's address space in bytes (``ulimit -v``), or None where there is none."""
    try:
        import resource
    except ImportError:
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else limit


@lru_cache(maxsize=2)  # asked for with every array that is kept
def container_limit(root: Path = Path("/")) -> int | None:
    """Return how many bytes the container or control group of this process may have, or None where nothing says so.

    Parameters
    ----------
    root : Path
        Where ``proc`` and ``sys`` are.
    """
    limits = []
    with suppress(OSError, ValueError):
        for line in (root / "proc/self/cgroup").read_text(encoding="utf-8").splitlines():
            controllers, own = line.split(":", 2)[1:]
            if controllers == "":  # version 2
                folder, name = root / "sys/fs/cgroup", "memory.max"
            elif "memory" in controllers.split(","):
                folder, name = root / "sys/fs/cgroup/memory", "memory.limit_in_bytes"
            else:
                continue
            place = folder / own.lstrip("/")
            for group in (place, *place.parents):  # a group is limited by those that it is in
                if group.is_relative_to(folder):
                    with suppress(OSError, ValueError):  # a container sees its own only; "max" is no limit
                        limits.append(int((group / name).read_text(encoding="ascii")))
    return min((limit for limit in limits if limit < NO_LIMIT), default=None)
