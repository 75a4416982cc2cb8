"""Errors of foreign programs that compiled equations ask: noted where they happen, raised when the equations return."""

__all__ = ["ASKS_FOREIGN", "FOREIGN_FAULTS"]

#: The line by which a text of equations that asks a foreign program is known.  Its machine code is kept by the text:
#: the number goes up when `multibody.fmi.asking` or its table changes.
ASKS_FOREIGN = "from multibody.fmi.asking import ask, key_of  # protocol 1\n"

#: Compiled code cannot raise: it goes on with nan, and `NativeFunction.check` raises the first of these.
FOREIGN_FAULTS: list[BaseException] = []
