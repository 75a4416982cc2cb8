"""Whether a process may have the memory that the smallest diagnosis takes, checked before work begins.

Libraries in C end the process where they get no memory, without a word or with one of their own: when it happens, it is
too late to report it.
"""

from __future__ import annotations

import os

from multibody.base.memory_of_process import address_space_limit, container_limit
from vtsdt.cli.arguments import CommandError

__all__ = ["LEAST_ADDRESS_SPACE", "check_memory", "reserve_nothing"]

#: Bytes of address space (``ulimit -v``) that the diagnosis of one record of 200 rows takes, most of it of libraries:
#: with 1.1 GiB it came to its end in six runs of seven, with 1.05 GiB in four of six (Python 3.11, Linux, two
#: processors, with and without compiled code in the cache).
LEAST_ADDRESS_SPACE = int(1.25 * 2**30)
#: Bytes of a container: the same diagnosis had 0.195 GiB of its own in memory, and 0.22 GiB with an empty cache.
LEAST_IN_CONTAINER = int(0.2 * 2**30)


def reserve_nothing() -> None:
    """Let Arrow ask for memory piece by piece where the address space is limited; a setting of the user stays.

    Its usual allocator reserves 1 GiB at once, and the smallest diagnosis then takes 2.1 GiB.  Before Arrow is
    imported.
    """
    if address_space_limit() is not None:
        os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")


def check_memory() -> None:
    """Refuse to begin a diagnosis for which there is too little memory in any case.

    Raises
    ------
    CommandError
        If the address space or the container's memory is limited to less than the smallest diagnosis takes.
    """
    limits = (
        (address_space_limit(), LEAST_ADDRESS_SPACE, "the address space of this process", "raise it (ulimit -v)"),
        (container_limit(), LEAST_IN_CONTAINER, "the memory of this container", "give the container more"),
    )
    for limit, least, what, remedy in limits:
        if limit is not None and limit < least:
            raise CommandError(
                f"{what} is limited to {limit / 2**30:.3g} GiB, and the smallest diagnosis takes about "
                f"{least / 2**30:.3g} GiB of it: {remedy}; nothing was begun, earlier results are kept"
            )
