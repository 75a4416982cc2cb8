"""Following a machine: a record is judged by itself, its history is watched, alarms are raised and delivered.

`StudyJudge` judges a record with a study's model, `watch` says of all records so far what has changed, `Follower` does
both and keeps the result in a store.  Takes from `operation.statistics`, `operation.store`, `operation.sources`,
`discrepancy`, `estimation` and `multibody`.
"""
