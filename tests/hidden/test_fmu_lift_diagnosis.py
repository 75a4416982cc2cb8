"""A lift that was exported and read back is given the same diagnosis as the native model."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest

from multibody.fmi.compiler import c_compiler

pytest.importorskip("fmpy", reason="needs fmpy: pip install 'vtsdt[fmi]'")
pytestmark = pytest.mark.skipif(c_compiler() is None, reason="needs a C compiler")

_PATH = Path(__file__).resolve().parents[2] / "benchmarks/fmu_lift.py"
_spec = importlib.util.spec_from_file_location("fmu_lift", _PATH)
assert _spec is not None
assert _spec.loader is not None
case = sys.modules["fmu_lift"] = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(case)


@pytest.mark.parametrize("fmi_version", ["3.0", pytest.param("2.0", marks=pytest.mark.slow)])
def test_a_lift_read_back_has_the_diagnosis_of_the_native_one(fmi_version: str, tmp_path: Path) -> None:
    case.write_case(tmp_path, fmi_version)
    native, read_back = (case.diagnosed(tmp_path, way) for way in case.WAYS)
    assert native.conclusion.verdict == read_back.conclusion.verdict == "effect found"
    assert native.effects == read_back.effects == [case.HIDDEN]
    assert native.strengths["viscous"] == pytest.approx(case.FRICTION, rel=0.02)  # the noise allows 1 %
    # both integrate with 1e-4 while they fit: six digits of the strength, four of what is left beside noise
    assert read_back.strengths == pytest.approx(native.strengths, rel=1e-5)
    assert read_back.errors == pytest.approx(native.errors, rel=1e-4)
    for name, noise in case.NOISE.items():
        assert native.errors[name] < 1.1 * noise
