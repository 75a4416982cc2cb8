"""Work that nobody waits for gives way to what a person has just asked for."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["GivingWay"]

PATIENCE = 1.0  # s for which the work rests at most at a time: a request that waits for it must not hold it for ever
PAUSE = 0.15  # s of rest after a request: a slider that moves asks again within this time


class GivingWay:
    """Requests in hand, and work in the background that rests while there are any.

    Examples
    --------
    >>> gate = GivingWay()
    >>> with gate.request():
    ...     gate.in_hand
    1
    >>> gate.in_hand
    0
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self.in_hand = 0

    @contextmanager
    def request(self) -> Iterator[None]:
        """Hold the work in the background while a request is answered."""
        with self._changed:
            self.in_hand += 1
        try:
            yield
        finally:
            with self._changed:
                self.in_hand -= 1
                self._changed.notify_all()

    def rest(self, patience: float = PATIENCE, pause: float = PAUSE) -> None:
        """Return once no request is in hand nor has been for a moment; at once where there is none.

        Parameters
        ----------
        patience : float, s
            Return after this time in any case.
        pause : float, s
            How long no request must have been in hand.
        """
        end = time.monotonic() + patience
        with self._changed:
            while self.in_hand and self._changed.wait_for(lambda: not self.in_hand, end - time.monotonic()):
                self._changed.wait_for(lambda: bool(self.in_hand), min(pause, end - time.monotonic()))
