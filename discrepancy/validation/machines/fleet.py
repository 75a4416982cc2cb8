"""The machines by name; each is imported when it is asked for."""

from __future__ import annotations

from importlib import import_module

from discrepancy.validation.machines.machine import Machine

__all__ = ["NAMES", "machine_named"]

NAMES = (
    "battery",
    "converter",
    "drive_train",
    "flywheel",
    "frame",
    "heated_tank",
    "linear_motor",
    "scanner",
    "shaker",
    "tanks",
    "valve",
    "vehicle",
    "web",
)


def machine_named(name: str) -> Machine:
    """Return a machine by its name.

    Raises
    ------
    KeyError
        With the names that exist.
    """
    if name not in NAMES:
        raise KeyError(f"there is no machine '{name}': take one of {', '.join(NAMES)}")
    machine: Machine = import_module(f"discrepancy.validation.machines.{name}").MACHINE
    return machine
