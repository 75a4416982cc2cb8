"""Rigid bodies in space: frames, trees of bodies in minimal coordinates, and what acts on them.

`symbols` writes vector algebra as text with zeros and ones left out, `frames` finds what each frame is fixed
to, `motion` writes position, velocity and acceleration of bodies and frames, `inertia` writes their equations
of motion, `tree` puts a model's bodies together.  `body` has the component `RigidBody`.
"""
