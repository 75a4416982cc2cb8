"""gearbox."""

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
