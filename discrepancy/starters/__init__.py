"""Studies that start themselves: from recordings and a kind of machine to a model, a study file and a first fit.

`kinds` lists the machines, `columns` finds out what a file's columns are, `start` writes the study, `command` is
``vtsdt init``.  Takes from `problem`, `residual` and `estimation`.
"""
