"""Models are built in several threads at once; Python 3.11 by itself cannot parse in two."""

from __future__ import annotations

import gc
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from multibody.base.parsing import expression, parse

LINE = "a{k} = (((b{k} + 1.0) * (c{k} - 2.0)) ** 2 if d{k} > 0.0 else f(g{k}, (h{k}, 1.0)))"
TEXT = "\n".join(LINE.format(k=k) for k in range(300))


@pytest.fixture
def threads_that_change_places():
    """While a tree is built, the collector of memory may let another thread go on; here it does so often."""

    def step_aside(phase, info):
        time.sleep(0.0)

    before = gc.get_threshold()
    gc.callbacks.append(step_aside)
    gc.set_threshold(50)
    yield
    gc.set_threshold(*before)
    gc.callbacks.remove(step_aside)


def test_many_threads_parse_at_once(threads_that_change_places):
    with ThreadPoolExecutor(8) as pool:
        trees = list(pool.map(parse, [TEXT] * 8))
    assert [len(tree.body) for tree in trees] == [300] * 8


def test_an_expression_alone():
    assert expression("1 + x").right.id == "x"
    with pytest.raises(SyntaxError):
        expression("x = 1")
