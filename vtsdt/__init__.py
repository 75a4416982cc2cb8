"""The lift, and the command line that serves all packages.

From here users import `Lift`, `LiftParameters`, the analyses of trips, `align`, `what_if` and the virtual lift; its
rooms offer more.  The public names stand in ``__init__.pyi`` and are imported on first use.  Takes from all others but
`gearbox`, which only the command line calls.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

#: Modules that stand in files of earlier versions, and where they are now (`multibody.base.references`).
MOVED = {
    "vtsdt.bench_model": "vtsdt.rig.models",
    "vtsdt.bench_parts": "vtsdt.rig.parts",
    "vtsdt.car": "vtsdt.parts.car",
    "vtsdt.control": "vtsdt.parts.control",
    "vtsdt.guide": "vtsdt.parts.guide",
    "vtsdt.machine": "vtsdt.parts.machine",
    "vtsdt.rope": "vtsdt.parts.rope",
}
