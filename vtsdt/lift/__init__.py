"""The lift as a model, its trips, and what is asked of them: energy, modes, comfort, pictures.

Takes from `vtsdt.parts` and `vtsdt.files`.
"""
