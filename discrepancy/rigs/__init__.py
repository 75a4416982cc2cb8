"""Virtual machines that write recordings, with effects hidden in them.

`axis` has the rig of a linear axis; `rig`, `recording`, `case` and `hidden_effects` are what rigs of other machines
are made of.  Takes from `discrepancy.effects`, `discrepancy.problem` and `discrepancy.questions`.
"""
