"""The gear stage: a model with tooth contact, its faults, vibration signals, a virtual rig, and model updating.

From here users import `GearStage`, its parameters and faults, signals and their analysis, `update` and `write_dataset`;
the public names stand in ``__init__.pyi`` and are imported on first use.  Takes from all packages but `vtsdt`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

#: Modules that stand in files of earlier versions, and where they are now (`multibody.base.references`).
MOVED = {
    "gearbox.bearings": "gearbox.parts.bearings",
    "gearbox.housing": "gearbox.parts.housing",
    "gearbox.mesh": "gearbox.parts.mesh",
    "gearbox.rig_encoders": "gearbox.rig.encoders",
    "gearbox.rig_hidden": "gearbox.rig.hidden",
    "gearbox.running": "gearbox.stage.running",
    "gearbox.shafts": "gearbox.parts.shafts",
    "gearbox.vibrating": "gearbox.stage.stage",
}
