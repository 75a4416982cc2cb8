"""Reading measurement files: formats, columns and units, checks, records.

Takes from `multibody.base`.
"""
