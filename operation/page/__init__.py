"""The page for those who maintain the machines: one file, no script, printable.

`write_page` writes it from a store and the states of its machines.  Takes from `operation.follow`, `operation.fleet`
and `operation.store`.
"""
