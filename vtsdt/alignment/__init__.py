"""The guide's alignment from a few sensors of the cabin: ``vtsdt align``.

Takes from `vtsdt.lift`, `vtsdt.rig` and `estimation`.
"""
