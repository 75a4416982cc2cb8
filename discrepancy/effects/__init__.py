"""The catalogue of effects that a machine may lack: kinds, laws, places, and how an effect enters a model.

Takes from `discrepancy.statistics` and `multibody`.
"""
