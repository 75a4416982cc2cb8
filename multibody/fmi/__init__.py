"""Models that travel as Functional Mock-up Units (FMI 2.0 and 3.0): a system written out, and foreign units read.

Export: `multibody.fmi.export`.  The C of a unit stands in ``sources``; only ``model.h`` is written anew for each model.
Import: `multibody.fmi.component.Fmu`, whose equations ask a process of its own (`multibody.fmi.foreign`).
Takes from `multibody.system` and what is below it.
"""
