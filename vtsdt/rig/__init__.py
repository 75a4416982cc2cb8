"""The virtual lift that writes recordings.

Takes from `vtsdt.lift` and `discrepancy.rigs`.
"""
