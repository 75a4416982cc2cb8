"""A fleet: records of many machines judged in parallel, what they say about each other, and what a year of it is worth.

`follow_fleet` judges, `fleet_view` gives priors, thresholds and outliers, `machine_states` the state of every machine,
`scores` compares a simulated year with its truth.  Takes from `operation.statistics`, `operation.store`,
`operation.follow` and `multibody.machine`.
"""
