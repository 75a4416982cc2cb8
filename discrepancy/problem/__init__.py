"""What a study file says, read and checked: model, records, what is uncertain.

Takes from `estimation` and `multibody`.
"""
