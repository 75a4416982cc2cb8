"""What updating a model returns: its outcome, which can be written as JSON and as a report."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gearbox.updating.json_file import content
from gearbox.updating.outcome import UpdatingOutcome
from gearbox.updating.report import write

__all__ = ["UpdatingResult"]


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class UpdatingResult(UpdatingOutcome):
    """The outcome of the chain with what can be done with it; fields as of `UpdatingOutcome`."""

    def to_dict(self) -> dict[str, Any]:
        """Return plain content, as ``updating.json`` holds it."""
        return content(self)

    def write(self, out: str | Path, subject: str = "") -> list[Path]:
        """Write ``updating.json``, ``report.html`` and the figures as PNG into a folder; return their paths.

        A folder that holds the results of another ``subject``, such as the study's name, is refused.
        """
        return write(self, out, subject)
