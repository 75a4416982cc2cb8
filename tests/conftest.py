"""What all tests share: where recordings are, what runs by default, and quiet, repeatable surroundings."""

from __future__ import annotations

import os
from pathlib import Path

# Before anything imports matplotlib or numpy: no window is ever opened, and two test processes on two cores
# must not start two linear-algebra threads each.
os.environ.setdefault("MPLBACKEND", "Agg")
if "PYTEST_XDIST_WORKER" in os.environ:
    for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(_name, "1")

import pytest
from hypothesis import settings

ROOT = Path(__file__).resolve().parent.parent

# A first call compiles, which a deadline would take for a slow example; in CI the same examples run every
# time, so that a run tells about the change and not about luck.
settings.register_profile("house", deadline=None, derandomize=bool(os.environ.get("CI")))
settings.load_profile("house")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark what reads recordings, leave out slow tests, and skip peers, unless ``-m`` names them."""
    wanted = config.option.markexpr
    kept: list[pytest.Item] = []
    left_out: list[pytest.Item] = []
    for item in items:
        if "measured_data" in getattr(item, "fixturenames", ()):
            item.add_marker("measured")
        if item.path.parent == ROOT / "tests" / "peers":
            item.add_marker("peers")
        if item.get_closest_marker("peers") and "peers" not in wanted:
            reason = "needs another program: pip install -c constraints.txt -e '.[test,peers]', then -m peers"
            item.add_marker(pytest.mark.skip(reason=reason))
        slow = item.get_closest_marker("slow") is not None and "slow" not in wanted
        (left_out if slow else kept).append(item)
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        items[:] = kept


def _folder(variable: str, beside: str, what: str) -> Path:
    given = os.environ.get(variable)
    path = Path(given).expanduser() if given else ROOT.parent / "shared" / beside
    if not path.is_dir():
        pytest.skip(f"{what} are not here: set {variable} to their folder (looked in {path})")
    return path.resolve()


@pytest.fixture(scope="session")
def measured_data() -> Path:
    """Folder of the real recordings: VTSDT_DATA, or ../shared/data beside the checkout."""
    return _folder("VTSDT_DATA", "data", "the real recordings")


@pytest.fixture(scope="session")
def reference_data() -> Path:
    """Folder of the reference simulations: VTSDT_REFERENCE, or ../shared/reference beside the checkout."""
    return _folder("VTSDT_REFERENCE", "reference", "the reference simulations")


class Interrupter:
    """Presses Ctrl-C when a certain line of progress comes."""

    def __init__(self, word: str) -> None:
        self.word = word

    def __call__(self, text: str) -> None:
        if self.word and text.startswith(self.word):
            self.word = ""
            raise KeyboardInterrupt


@pytest.fixture(scope="session")
def interrupter() -> type[Interrupter]:
    """What breaks a search off at a line of its progress."""
    return Interrupter
