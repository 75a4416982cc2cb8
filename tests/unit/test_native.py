"""Generated source becomes native functions: cached across processes, never stale, same in plain Python."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import textwrap
import threading
from pathlib import Path

import numpy as np
import pytest

from multibody.base.cache import digest_of, write_once
from multibody.compile import native

PENDULUM = """
import math

from numba import njit


@njit(cache=True, error_model="numpy")
def torque(angle, p):
    return -p[0] * math.sin(angle)


def rhs(t, x, u, p, dx):
    dx[0] = x[1]
    if x[1] > 0.0:
        dx[1] = torque(x[0], p) - p[1] * x[1] + u[0]
    else:
        dx[1] = torque(x[0], p) + u[0]


def rhs_tangent(t, x, u, p, x_dot, u_dot, p_dot, out):
    out[0] = x_dot[1]
    out[1] = -p_dot[0] * math.sin(x[0]) - p[0] * math.cos(x[0]) * x_dot[0] + u_dot[0]
    if x[1] > 0.0:
        out[1] -= p_dot[1] * x[1] + p[1] * x_dot[1]
"""


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("VTSDT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def run(code: str, cache: Path, **environment: str) -> str:
    """Run code in a fresh interpreter and return what it writes."""
    env = {**os.environ, "VTSDT_CACHE": str(cache), **environment}
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(code)], env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_cache_dir_follows_the_environment_and_names_the_remedy(tmp_path, monkeypatch):
    monkeypatch.setenv("VTSDT_CACHE", str(tmp_path / "a" / "b"))
    assert native.cache_dir() == tmp_path / "a" / "b"
    assert native.cache_dir().is_dir()
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("VTSDT_CACHE", str(tmp_path / "file" / "x"))
    with pytest.raises(OSError, match="set VTSDT_CACHE to a writable folder"):
        native.cache_dir()


def test_digest_depends_on_the_texts_and_their_borders():
    assert digest_of("a", "b") == digest_of("a", "b")
    assert digest_of("ab") != digest_of("a", "b") != digest_of("b", "a")


def test_same_text_is_the_same_file_and_module(cache):
    first = native.load_source("value = 1\n", "thing")
    stamp = Path(first.__file__).stat().st_mtime_ns
    assert native.load_source("value = 1\n", "thing") is first
    assert native.load_source("value = 2\n", "thing").value == 2
    assert first.value == 1
    # A new time stamp would make numba throw its compiled code away.
    del sys.modules[first.__name__]
    again = native.load_source("value = 1\n", "thing")
    assert again.__file__ == first.__file__
    assert Path(again.__file__).stat().st_mtime_ns == stamp


def test_source_that_fails_is_not_left_behind(cache):
    before = set(sys.modules)
    with pytest.raises(ZeroDivisionError):
        native.load_source("1 / 0\n", "broken")
    assert set(sys.modules) == before


def test_many_writers_leave_one_whole_file(cache):
    text = "x = '" + "a" * 200_000 + "'\n"
    path = native.cache_dir() / "many.py"
    seen = []

    def write():
        write_once(path, text)
        seen.append(path.read_text())

    threads = [threading.Thread(target=write) for _ in range(16)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert seen == [text] * 16
    assert [p.name for p in native.cache_dir().iterdir()] == ["many.py"]


@pytest.mark.parametrize("compiled", [True, False])
def test_function_and_tangent_agree_with_plain_python(cache, compiled):
    module = native.load_source(PENDULUM, "pendulum")
    rhs = native.compile_rhs(module, compile=compiled)
    tangent = native.compile_tangent(module, compile=compiled)
    assert rhs.compiled is compiled
    assert rhs.address != tangent.address != 0
    rng = np.random.default_rng(1)
    for _ in range(20):
        x, u, p = rng.normal(size=2), rng.normal(size=1), rng.normal(size=2)
        xd, ud, pd = rng.normal(size=2), rng.normal(size=1), rng.normal(size=2)
        expected = np.empty(2)
        rhs.python(0.0, x, u, p, expected)
        # The same arithmetic in the same order; only the library's sine may differ in the last digits.
        np.testing.assert_allclose(rhs(0.0, x, u, p, np.empty(2)), expected, rtol=1e-14)
        tangent.python(0.0, x, u, p, xd, ud, pd, expected)
        np.testing.assert_allclose(tangent(0.0, x, u, p, xd, ud, pd, np.empty(2)), expected, rtol=1e-13)


def test_call_takes_any_input_array_but_only_a_fit_output(cache):
    rhs = native.compile_rhs(native.load_source(PENDULUM, "pendulum"))
    wide = np.arange(8.0).reshape(4, 2)
    straight = rhs(0.0, wide[::2, 0].copy(), [1.0], [1, 2], np.empty(2))
    np.testing.assert_array_equal(rhs(0.0, wide[::2, 0], [1.0], [1, 2], np.empty(2)), straight)
    with pytest.raises(TypeError, match="contiguous float64"):
        rhs(0.0, [0.0, 1.0], [1.0], [1.0, 2.0], np.empty(4)[::2])
    with pytest.raises(TypeError, match="takes t and 4 arrays, 3 arrays"):
        rhs(0.0, [0.0, 1.0], [1.0], np.empty(2))


@pytest.mark.parametrize("compiled", [True, False])
def test_division_by_zero_is_not_finite_and_does_not_raise(cache, compiled):
    text = "def rhs(t, x, u, p, dx):\n    dx[0] = x[0] / p[0]\n"
    rhs = native.compile_rhs(native.load_source(text, "divide"), compile=compiled)
    assert not np.isfinite(rhs(0.0, [1.0], [0.0], [0.0], np.empty(1))[0])


def test_a_fault_in_plain_python_reaches_the_caller(cache):
    text = "def rhs(t, x, u, p, dx):\n    dx[0] = unknown_name\n"
    rhs = native.compile_rhs(native.load_source(text, "faulty"), compile=False)
    with pytest.raises(NameError, match="unknown_name"):
        rhs(0.0, [1.0], [0.0], [0.0], np.empty(1))


def test_second_process_compiles_nothing(cache):
    code = f"""
        import logging, numpy as np
        from multibody.compile import native
        from multibody.inputs.table import InputTable
        from multibody.solvers import NativeProblem, integrate
        told = []
        native.on_compile(lambda name, seconds: told.append(name) if seconds is None else None)
        module = native.load_source({PENDULUM!r}, "pendulum")
        rhs, tangent = native.compile_rhs(module), native.compile_tangent(module)
        problem = NativeProblem(
            rhs=rhs, p=[9.81, 0.1], table=InputTable.constant([0.0]), n=2, tangent=tangent
        )
        print(integrate(problem, (0.0, 1.0), [1.0, 0.0], [1.0]).y[0, 0], tangent.address > 0, *told)
    """
    first, second = run(code, cache).split(), run(code, cache).split()
    assert {"rhs", "rhs_tangent", "advance_one"} <= set(first[2:])
    assert second == first[:2]


def test_function_can_be_sent_to_another_process(cache):
    import pickle

    rhs = native.compile_rhs(native.load_source(PENDULUM, "pendulum"))
    sent = pickle.dumps(rhs)
    code = f"""
        import pickle, numpy as np
        rhs = pickle.loads({sent!r})
        print(rhs(0.0, [0.0, 2.0], [1.0], [1.0, 2.0], np.empty(2))[1])
    """
    assert float(run(code, cache)) == -3.0


def test_an_edited_helper_of_a_kernel_is_never_served_stale(cache, tmp_path):
    package = tmp_path / "edited"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "driver.py").write_text(
        "from multibody.compile.calls import entry\nfrom edited.middle import middle\n\n\n"
        "@entry\ndef drive(x):\n    return middle(x)\n"
    )
    (package / "middle.py").write_text(
        "from multibody.compile.calls import inner\nfrom edited.helper import helper\n\n\n"
        "@inner\ndef middle(x):\n    return helper(x)\n"
    )
    code = """
        from multibody.compile import native
        from edited.driver import drive
        told = []
        native.on_compile(lambda name, seconds: told.append(name))
        print(drive(1.0), "compiled" if told else "cached")
    """
    results = []
    for factor in (2, 2, 3):
        helper = package / "helper.py"
        if not helper.exists() or f"{factor} *" not in helper.read_text():
            helper.write_text(
                f"from multibody.compile.calls import inner\n\n\n@inner\ndef helper(x):\n    return {factor} * x\n"
            )
            os.utime(helper, (1.0, 1.0))  # the time stamp says nothing
        results.append(
            run(
                code,
                cache,
                PYTHONPATH=os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]),
                PYTHONDONTWRITEBYTECODE="1",
            )
        )
    assert results == ["2.0 compiled", "2.0 cached", "3.0 compiled"]


def test_damaged_code_of_a_kernel_is_made_anew(cache, tmp_path):
    (tmp_path / "damaged.py").write_text(
        "from multibody.compile.calls import entry\n\n\n@entry\ndef treble(x):\n    return 3.0 * x\n"
    )
    code, path = "from damaged import treble; print(treble(2.0))", os.environ.get("PYTHONPATH", "")
    around = {"PYTHONPATH": os.pathsep.join([str(tmp_path), path])}
    assert run(code, cache, **around) == "6.0"
    (kept,) = cache.glob("damaged_treble_*.o")
    whole = kept.read_bytes()
    for content in (b"", whole[: len(whole) // 2], whole[:-1] + bytes([whole[-1] ^ 1])):
        kept.write_bytes(content)
        assert run(code, cache, **around) == "6.0"
        assert kept.read_bytes() == whole


def test_everything_runs_without_compilation(cache):
    code = f"""
        import numpy as np
        from multibody.compile import native
        from multibody.inputs.table import InputTable
        from multibody.solvers import NativeProblem, integrate
        module = native.load_source({PENDULUM!r}, "pendulum")
        rhs = native.compile_rhs(module)
        table = InputTable.from_columns([0.0, 0.5, 1.0], {{"u": [0.0, 1.0, 0.0]}})
        problem = NativeProblem(rhs=rhs, p=[9.81, 0.1], table=table, n=2)
        result = integrate(problem, (0.0, 1.0), [1.0, 0.0], [0.5, 1.0], rtol=1e-8, atol=1e-8)
        print(rhs.compiled, *map(repr, map(float, result.y.ravel())))
    """
    compiled, plain = run(code, cache).split(), run(code, cache, NUMBA_DISABLE_JIT="1").split()
    assert (compiled[0], plain[0]) == ("True", "False")
    # Same steps and same arithmetic; only sums contracted by the compiler differ, far below the tolerance
    # 1e-8.
    np.testing.assert_allclose([float(v) for v in compiled[1:]], [float(v) for v in plain[1:]], rtol=1e-12)


def test_compilation_is_told_once_and_logged(cache, caplog):
    told = []
    stop = native.on_compile(lambda name, seconds: told.append((name, seconds)))
    text = "def rhs(t, x, u, p, dx):\n    dx[0] = 17.25 * x[0]\n"
    with caplog.at_level(logging.INFO, logger="multibody.compile.native"):
        first = native.compile_rhs(native.load_source(text, "told"))
        assert told == []  # nothing is compiled before it is asked for
        assert first.address
    stop()
    assert native.compile_rhs(native.load_source(text + "\n# other\n", "told")).address
    assert [name for name, _ in told] == ["rhs", "rhs"]
    assert told[0][1] is None
    assert told[1][1] > 0.0
    assert "compiling rhs" in caplog.text
