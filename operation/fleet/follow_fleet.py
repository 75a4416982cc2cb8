"""Records of many machines, judged in worker processes or on a cluster, kept in one store."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

from multibody.machine.run_many import run_many
from operation.store.judgement import Judgement
from operation.store.store import Store

__all__ = ["FleetRun", "follow_fleet"]


@dataclass(frozen=True, kw_only=True)
class FleetRun:
    """What judging a fleet took.

    Parameters
    ----------
    records, new, failed : int
    seconds : float
        Of processor time in the workers, for judging alone.
    faults : tuple of str
        Of calls that failed.
    """

    records: int
    new: int
    failed: int
    seconds: float
    faults: tuple[str, ...] = ()

    @property
    def seconds_per_record(self) -> float:
        """Processor time of a record."""
        return self.seconds / max(self.records, 1)


@dataclass(frozen=True)
class _Timed:
    """A judge that says how long it took; it can be sent to another process."""

    judge: Callable[[Any], tuple[str, Judgement]]

    def __call__(self, item: Any) -> tuple[str, Judgement, float]:
        begun = time.process_time()
        machine, judgement = self.judge(item)
        return machine, judgement, time.process_time() - begun


def follow_fleet(
    judge: Callable[[Any], tuple[str, Judgement]],
    items: Iterable[Any],
    store: Store,
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> FleetRun:
    """Judge records of many machines and keep what they say.

    Parameters
    ----------
    judge : callable
        Takes an item, returns the machine's name and the judgement; defined at the top of a module, because it runs in
        other processes.
    items : iterable
        Records, in any order.
    store : Store
        Written by this process only.
    executor : concurrent.futures.Executor, optional
        Such as that of a Dask cluster (``client.get_executor()``); default: a pool of processes.
    workers : int, optional
    progress : callable, optional
    """
    records = new = failed = 0
    seconds, faults = 0.0, []
    for outcome in run_many(_Timed(judge), items, executor=executor, workers=workers, progress=progress):
        if not outcome.success:
            failed += 1
            faults.append(f"record {outcome.index + 1}: {outcome.error}")
            continue
        machine, judgement, took = outcome.value
        records += 1
        seconds += took
        new += store.add(machine, judgement)
    return FleetRun(records=records, new=new, failed=failed, seconds=seconds, faults=tuple(faults))
