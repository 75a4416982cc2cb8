"""The virtual gear rig that writes recordings.

Takes from `gearbox.stage` and `discrepancy.rigs`.
"""
