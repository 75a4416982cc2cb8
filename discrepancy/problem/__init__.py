"""The problem that a study solves, read from a study file and checked: model, records, uncertain parameters.

`read_problem` and `Problem` are in `problem`; `study_file`, `tables`, `paths` and `model` are the steps of reading.
Takes from `estimation` and `multibody`.
"""
