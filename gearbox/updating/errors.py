"""What can go wrong in an updating study, as one kind of error."""

from __future__ import annotations

from discrepancy.problem.study_file import StudyError

__all__ = ["UpdatingError"]


class UpdatingError(StudyError):
    """A model cannot be updated as asked; ``faults`` holds one sentence for each fault."""
