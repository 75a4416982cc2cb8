"""Measurement files: tables of each format, column names and units, checks, and the records made of them.

Import `read_records` and `read_record` from `estimation.files.read_records`, `Record` from `estimation.files.record`,
`ReadRules` from `estimation.files.read_rules`, `RecordError` from `estimation.files.faults`.
Takes from `multibody.base`.
"""
