"""The memory of a twin: one folder with a SQLite file of judgements and events, and a Parquet file for each record.

`Store` writes and reads, `Judgement` is what it keeps of a record.  The schema is on the page *The twin in operation*.
Takes from `multibody.base`.
"""
