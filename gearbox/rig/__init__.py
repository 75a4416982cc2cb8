"""The virtual gear rig: a richer stage measured by accelerometers or encoders, suites, and labelled data.

The command line, `gearbox.papers` and validations import from here.  Takes from `gearbox.stage` and `discrepancy.rigs`.
"""
