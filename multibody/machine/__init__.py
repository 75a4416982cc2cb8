"""What users hold: `Model`, a graph of components that can be built, and `System`, its compiled equations.

Their methods join the rooms below: `model.build()`, `model.save(path)`, `system.simulate(…)`, `system.linearize(…)`.
Takes from every other room but the library.
"""
