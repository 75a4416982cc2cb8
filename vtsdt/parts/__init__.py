"""The lift's components: car, guide, rope, machine, control.

Takes from `multibody`.
"""
