"""A map over threads: results in order, the first error in order, and no waiting for a thread that never begins."""

from __future__ import annotations

import threading

import pytest

from multibody.base import parallel
from multibody.base.parallel import available_cores, parallel_map


@pytest.fixture(autouse=True)
def four_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parallel.os, "cpu_count", lambda: 4)


def test_results_stand_in_the_order_of_the_items_and_cores_are_shared() -> None:
    met = threading.Barrier(4, timeout=20.0)

    def work(item: int) -> tuple[int, int]:
        met.wait()  # four at a time
        return item, available_cores()

    assert parallel_map(work, range(8)) == [(k, 1) for k in range(8)]
    assert available_cores() == 4


def test_nested_calls_share_the_cores() -> None:
    assert parallel_map(lambda _: parallel_map(lambda _: available_cores(), range(3)), range(2)) == [[1] * 3] * 2


def test_the_first_error_in_order_is_raised_when_all_that_began_have_ended() -> None:
    ended = []

    def work(item: int) -> None:
        if item == 1:
            raise KeyError(item)
        threading.Event().wait(0.05)
        ended.append(item)
        if item == 2:
            raise ValueError(item)

    with pytest.raises(KeyError):
        parallel_map(work, range(100))
    began = set(ended)
    threading.Event().wait(0.2)
    assert set(ended) == began <= {0, 2, 3, 4, 5, 6}


@pytest.mark.parametrize("dies", [True, False])
def test_a_thread_that_never_begins_is_not_waited_for(monkeypatch: pytest.MonkeyPatch, dies: bool) -> None:
    def start(function: object, arguments: tuple[bool]) -> None:
        if not dies:
            raise RuntimeError("can't start new thread")

    monkeypatch.setattr(parallel._thread_module, "start_new_thread", start)
    assert parallel_map(lambda k: -k, range(5)) == [0, -1, -2, -3, -4]
