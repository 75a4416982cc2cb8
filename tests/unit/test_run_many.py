"""Many runs by any executor: in order, with failures one by one, in constant memory."""

from __future__ import annotations

import os
from concurrent.futures import Executor, Future, ThreadPoolExecutor

import numpy as np
import pytest

from multibody import Model
from multibody.library import Mass, Spring
from multibody.machine.run_many import AHEAD, run_many, simulate_many


def reciprocal(x: float) -> float:
    return 1.0 / x


def oscillator() -> Model:
    model = Model("oscillator")
    body, spring = model.add("body", Mass(m=2.0, position=0.1)), model.add("spring", Spring(stiffness=50.0))
    model.connect(spring.a, model.ground)
    model.connect(spring.b, body.flange)
    return model


def last_position(run) -> tuple[int, float]:
    return os.getpid(), float(run["body.position"][-1])


def plan(count: int):
    return ({"until": 1.0, "parameters": {"spring.stiffness": 50.0 + k}} for k in range(count))


def test_a_pool_of_processes_brings_results_in_order_and_loses_none_to_a_failure():
    outcomes = list(run_many(reciprocal, [1.0, 0.0, 4.0, 5.0], workers=2))
    assert [o.index for o in outcomes] == [0, 1, 2, 3]
    assert [o.value for o in outcomes] == [1.0, None, 0.25, 0.2]
    assert [o.success for o in outcomes] == [True, False, True, True]
    assert "ZeroDivisionError" in outcomes[1].error


class Counting(Executor):
    """Runs at once, and counts what was handed in but not yet fetched."""

    def __init__(self) -> None:
        self.submitted = 0

    def submit(self, function, /, *args, **kwargs):  # type: ignore[no-untyped-def]
        self.submitted += 1
        future: Future = Future()
        future.set_result(function(*args))
        return future


def test_items_are_drawn_only_as_they_are_needed():
    executor, done = Counting(), 0
    for done, outcome in enumerate(run_many(reciprocal, iter(range(1, 10**9)), executor=executor, workers=2), 1):
        assert executor.submitted <= done - 1 + 2 * AHEAD
        if outcome.index == 50:
            break
    assert done == 51


def test_simulations_in_processes_are_those_of_this_process_to_the_last_bit():
    runs = list(plan(6))
    runs[2] = {"until": 1.0, "parameters": {"spring.no": 1.0}}
    outcomes = list(simulate_many(oscillator(), iter(runs), last_position, workers=2))
    assert "there is no parameter 'spring.no'" in outcomes[2].error
    system = oscillator().build()
    for k, outcome in enumerate(outcomes):
        if k != 2:
            pid, value = outcome.value
            assert pid != os.getpid()
            assert value == last_position(system.simulate(**runs[k]))[1]


def test_outputs_by_name_and_progress(monkeypatch):
    lines: list[str] = []
    with ThreadPoolExecutor(2) as pool:
        outcomes = list(simulate_many(oscillator(), plan(3), ["body.position"], executor=pool, progress=lines.append))
    assert [o.value.shape for o in outcomes] == [(1001, 1)] * 3
    assert lines == ["run 1", "run 2", "run 3"]
    with pytest.raises(KeyError, match=r"no quantity 'body\.positron'"):
        simulate_many(oscillator(), plan(1), ["body.positron"])


@pytest.mark.slow
def test_a_cluster_of_dask_gives_the_same(tmp_path):
    distributed = pytest.importorskip("distributed", reason="the extra [dask] is not installed")
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, local_directory=tmp_path, silence_logs=50
    )
    with cluster, distributed.Client(cluster) as client, client.get_executor() as executor:
        outcomes = list(simulate_many(oscillator(), plan(8), ["body.position"], executor=executor, workers=2))
    system = oscillator().build()
    for k, run in enumerate(plan(8)):
        np.testing.assert_array_equal(outcomes[k].value[:, 0], system.simulate(**run)["body.position"])
