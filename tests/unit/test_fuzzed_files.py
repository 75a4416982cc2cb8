"""Study files, recordings and histories with letters changed, lost or added: read, or refused in known words."""

from __future__ import annotations

from pathlib import Path

import pytest
from broken_inputs import Broken, csv, rows, write
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from discrepancy.problem.problem import read_problem
from discrepancy.study.history import read_history
from vtsdt.cli.command_line import _is_named

#: Pieces that mean something in one of the formats, so that a change is more than an unknown letter.
PIECES = st.sampled_from(
    [*"'\"[]{}=,\n#-0*\x00é", "1e999", "nan", "9" * 400, "null", "true"],
)
CHANGES = st.lists(
    st.tuples(st.floats(0.0, 1.0), st.integers(0, 9), PIECES | st.text(max_size=3)), min_size=1, max_size=4
)
FEW = settings(
    max_examples=60, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
HISTORY = '{"schema": 1, "study": "a", "fingerprint": "0f", "seed": 1, "settled": true, "steps": [], "stages": []}'


def changed(text: str, changes: list[tuple[float, int, str]]) -> bytes:
    """Return a text in which some pieces are replaced, each at a share of its length."""
    for share, lost, piece in changes:
        at = int(share * len(text))
        text = text[:at] + piece + text[at + lost :]
    return text.encode("utf-8", "surrogatepass")


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(Broken("sound", "", {}), tmp_path_factory.mktemp("fuzzed"))


def accepted_or_refused(action: object) -> None:
    """Call, and let no error pass but those whose message says what to do."""
    refusal: Exception | None = None
    try:
        action()  # type: ignore[operator]
    except Exception as error:
        refusal = error
    if refusal is not None:
        assert _is_named(refusal), f"{type(refusal).__name__}: {refusal}"
        assert str(refusal).strip()


@FEW
@given(changes=CHANGES)
def test_a_study_file(study: Path, changes: list[tuple[float, int, str]]) -> None:
    other = study.with_name("changed.toml")
    other.write_bytes(changed(study.read_text(), changes))
    accepted_or_refused(lambda: read_problem(other))


@FEW
@given(changes=CHANGES)
def test_a_recording(study: Path, changes: list[tuple[float, int, str]]) -> None:
    recording = study.with_name("a.csv")
    recording.write_bytes(changed(csv(rows(1)), changes))
    accepted_or_refused(lambda: read_problem(study))
    recording.write_text(csv(rows(1)))


@FEW
@given(changes=CHANGES)
def test_a_history(tmp_path: Path, changes: list[tuple[float, int, str]]) -> None:
    path = tmp_path / "history.json"
    path.write_bytes(changed(HISTORY, changes))
    accepted_or_refused(lambda: read_history(path))


def test_the_rule_sees_an_error_that_nobody_foresaw() -> None:
    with pytest.raises(AssertionError, match="KeyError"):
        accepted_or_refused(lambda: {}["a"])
