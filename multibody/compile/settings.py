"""What the environment says about compilation."""

from __future__ import annotations

import os
from functools import lru_cache

__all__ = ["jit_enabled", "models_by_emitter"]


@lru_cache(maxsize=1)
def jit_enabled() -> bool:
    """Tell whether functions are compiled (``NUMBA_DISABLE_JIT=1`` turns that off)."""
    return os.environ.get("NUMBA_DISABLE_JIT", "0").strip() in ("", "0")


@lru_cache(maxsize=1)
def models_by_emitter() -> bool:
    """Tell whether ``VTSDT_COMPILER=emitter`` asks for the emitter in place of numba, to compare the two.

    `benchmarks/compilers.py` does that; functions compiled by numba cannot call what the emitter has compiled.
    """
    return os.environ.get("VTSDT_COMPILER", "numba") == "emitter"
