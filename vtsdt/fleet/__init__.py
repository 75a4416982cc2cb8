"""A fleet of lifts: what a visit of two trips says of the guides, what changes mean, a simulated year with its truth.

`judge_trips` judges a visit, `lift_causes` names what has come in, `simulated_year` runs a fleet from the virtual rig.
Takes from `vtsdt.alignment`, `vtsdt.whatif`, `vtsdt.rig`, `vtsdt.files` and `operation`.
"""
