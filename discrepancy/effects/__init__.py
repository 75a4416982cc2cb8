"""The effects that a machine may lack: kinds, laws, places, shapes to try, and how an effect enters a model.

`kinds` and `laws` hold what ships, `register` adds a kind, `catalogue` lists the candidates of a machine, and `effect`
has `Effect`.  Takes from `discrepancy.statistics`, `estimation` and `multibody`.
"""
