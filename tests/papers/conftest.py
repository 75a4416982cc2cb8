"""What the papers' slow tests share: simulations of the gear stage, each done once in a session."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def gear_runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with one file of runs for each housing, named as `gearbox.papers.gearbox.chapters` names them."""
    return tmp_path_factory.mktemp("gear_runs")
