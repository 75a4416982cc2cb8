"""The lift, and the command line that serves all packages."""

from __future__ import annotations

__all__ = ["__version__"]


def __getattr__(name: str) -> str:
    """Look the installed version up when it is asked for: reading it takes long."""
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("vtsdt")
        except PackageNotFoundError:  # a source tree that was put on the path and never installed
            return "0+unknown"
    raise AttributeError(f"module 'vtsdt' has no attribute '{name}'")

#: Modules that stand in files of earlier versions, and where they are now (`multibody.base.references`).
MOVED = {
    "vtsdt.bench_model": "vtsdt.rig.models",
    "vtsdt.bench_parts": "vtsdt.rig.parts",
    "vtsdt.car": "vtsdt.parts.car",
    "vtsdt.control": "vtsdt.parts.control",
    "vtsdt.guide": "vtsdt.parts.guide",
    "vtsdt.lift": "vtsdt.lift.lift",
    "vtsdt.machine": "vtsdt.parts.machine",
    "vtsdt.rope": "vtsdt.parts.rope",
}
