"""Arrays that do not fit into the memory allowed: kept in a file, with the same answers to the last bit."""

import gc
import threading

import numpy as np
import pytest

from discrepancy.statistics import columns as packs
from discrepancy.statistics.blocks import Candidate, KeptSensitivities
from discrepancy.statistics.columns import Columns
from discrepancy.statistics.masking_pairs import PairScores
from discrepancy.statistics.scan import scan
from discrepancy.validation import linear_axes
from multibody.base import memory
from multibody.base.memory import ArrayStore, MemoryLimitError, memory_limit
from vtsdt.cli.command_line import main


@pytest.fixture
def nothing_held(monkeypatch):
    """Every array goes into a file."""
    monkeypatch.setenv("VTSDT_MEMORY", "1e-9")


def kept(candidates):
    """Return candidates whose sensitivities are in a store."""
    store = ArrayStore()
    return [
        Candidate(
            kind=c.kind,
            where=c.where,
            sensitivities=KeptSensitivities(store, [[store.put(b) for b in blocks] for blocks in c.sensitivities]),
            shapes=c.shapes,
            one_sided=c.one_sided,
            strengths=c.strengths,
            unit=c.unit,
        )
        for c in candidates
    ], store


def test_a_store_may_be_freed_by_the_collector_while_another_counts_what_it_holds():
    """A search had hung: its thread waited for a lock that it held itself."""
    before = ArrayStore()
    before.put(np.zeros(3))

    def freed() -> None:
        with memory._lock:
            before._own.free()

    thread = threading.Thread(target=freed, daemon=True)
    thread.start()
    thread.join(10.0)
    assert not thread.is_alive()
    assert before._own.held == 0


def test_a_scan_from_a_file_is_the_same_to_the_last_bit(monkeypatch):
    rng = np.random.default_rng(3)
    axis = linear_axes.make_axis(rng, 3, duration=4.0)
    case = linear_axes.make_case(axis, "ar2", rng, ())
    monkeypatch.setattr(packs, "PACK_BYTES", 8 * 5 * case.residual.n_samples)  # five columns: many packs

    def scanned():
        candidates, store = kept(linear_axes.candidates(axis))
        return scan(case.residual, case.sensitivities, candidates, draws=60, seed=3), store

    held, held_store = scanned()
    assert held_store.nbytes_in_file == held.scorer.columns.Z.store.nbytes_in_file == 0
    assert len(held.scorer.columns.Z.numbers) > 3
    monkeypatch.setenv("VTSDT_MEMORY", "1e-9")
    read, read_store = scanned()
    assert read_store.nbytes_in_file > 0
    assert read.scorer.columns.Z.store.nbytes_in_file > 0
    assert read.to_frame().to_dict() == held.to_frame().to_dict()
    np.testing.assert_array_equal(read.null.neg_log_p, held.null.neg_log_p)
    pairs = [PairScores(r) for r in (held, read)]
    assert [p.gain for p in pairs[0].masking()] == [p.gain for p in pairs[1].masking()]
    assert pairs[0].p_value(3.0, 1) == pairs[1].p_value(3.0, 1)


def test_the_size_of_a_pack_does_not_matter(monkeypatch):
    rng = np.random.default_rng(4)
    axis = linear_axes.make_axis(rng, 3, duration=4.0)
    case = linear_axes.make_case(axis, "ar2", rng, ())

    def rows():
        result = scan(case.residual, case.sensitivities, linear_axes.candidates(axis), draws=60, seed=3, whiten=False)
        return {r.name: (r.score, r.inflation, r.delta_bic, r.held_out_gain) for r in result.rows}

    whole = rows()
    monkeypatch.setattr(packs, "TOGETHER", 3)
    monkeypatch.setattr(packs, "PACK_BYTES", 8 * 3 * case.residual.n_samples)
    for name, values in rows().items():
        np.testing.assert_allclose(values, whole[name], rtol=1e-9, atol=1e-9)  # sums in another order


def test_columns_are_what_the_matrix_would_give(nothing_held):
    rng = np.random.default_rng(0)
    parts = [rng.standard_normal((40, k)) for k in (3, 1, 4)]
    Z = np.concatenate(parts, axis=1)
    columns = Columns.of(parts, 40)
    used = np.array([True, False, True, False, True, True, True, False])
    some = columns.only(used)
    np.testing.assert_array_equal(columns.matrix(), Z)
    np.testing.assert_array_equal(some.matrix(), Z[:, used])
    np.testing.assert_array_equal(some[slice(1, 4)], Z[:, used][:, 1:4])
    np.testing.assert_allclose(some.gram(), Z[:, used].T @ Z[:, used], atol=1e-12)
    np.testing.assert_allclose(some.transposed_times(Z), Z[:, used].T @ Z, atol=1e-12)
    np.testing.assert_array_equal(columns.selected([slice(6, 8), slice(0, 2)]).matrix(), Z[:, [6, 7, 0, 1]])


def test_what_a_store_held_is_free_again(monkeypatch):
    gc.collect()
    before = memory._held  # stores of other tests may be there still
    monkeypatch.setenv("VTSDT_MEMORY", str((before + 0.5e6) / memory.KEPT / 1e9))
    store = ArrayStore()
    first = store.put(np.ones(1000))
    assert memory._held == before + 8000
    second = store.put(np.arange(100_000.0))  # 0.8 MB where half of one is left
    assert store.nbytes_in_file == 800_000
    np.testing.assert_array_equal(store.get(second), np.arange(100_000.0))
    np.testing.assert_array_equal(store.get(first), np.ones(1000))
    del store
    gc.collect()
    assert memory._held == before


def test_a_folder_that_cannot_be_written_names_itself_and_the_remedies(nothing_held, monkeypatch, tmp_path):
    monkeypatch.setenv("VTSDT_SCRATCH", str(tmp_path / "none"))
    with pytest.raises(OSError, match=r"none: 8e-06 MB more .* VTSDT_SCRATCH, raise the limit with --memory"):
        ArrayStore().put(np.ones(1))


def test_a_limit_that_is_no_number_is_refused(monkeypatch, capsys):
    monkeypatch.setenv("VTSDT_MEMORY", "much")
    with pytest.raises(MemoryLimitError, match="VTSDT_MEMORY is 'much'"):
        memory_limit()
    assert main(["compare", "none.toml", "--out", "out", "--memory", "much"]) == 2
    assert "--memory: 'much' is no amount of memory" in capsys.readouterr().err
    assert main(["compare", "none.toml", "--out", "out", "--memory", "0.001"]) == 2
    assert "--memory: 0.001 GB must be at least 0.01: give gigabytes" in capsys.readouterr().err
    monkeypatch.setenv("VTSDT_MEMORY", "3")
    assert memory_limit() == 3e9


def test_memory_that_is_used_up_is_told_with_the_remedy(monkeypatch, capsys):
    def much(*args):
        raise MemoryError("Unable to allocate 9 GiB")

    monkeypatch.setattr("vtsdt.cli.command_line._dispatch", much)
    assert main(["diagnose"]) == 2
    assert "used up (Unable to allocate 9 GiB): give it more, lower --memory" in capsys.readouterr().err
