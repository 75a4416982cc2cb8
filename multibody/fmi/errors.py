"""What is raised when an FMU cannot be written or used."""

__all__ = ["FmuError"]


class FmuError(ValueError):
    """An FMU cannot be written, read or run; the message gives the reason and the remedy."""
