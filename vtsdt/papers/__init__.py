"""The papers' tables made again and compared: ``vtsdt validate papers``.

Takes from every other room of the lift.
"""
