"""The form in which a residual is taken: whole records, windows, or prescribed motion; noise of inputs; tolerances.

`residual_mode.prepared_problem` chooses it and returns a `prepared_problem.PreparedProblem`.
Takes from `discrepancy.problem` and the rooms below it.
"""
