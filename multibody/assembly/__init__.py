"""From a model's graph to its equations: kinematics, Newton's law, order of evaluation, places for effects.

To import from here: `assemble`, `find_places`, `Place`, and the equations as data (`equation_set`).  Takes from
`multibody.model` and the rooms below it.
"""
