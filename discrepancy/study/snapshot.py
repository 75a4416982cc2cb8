"""A study at one moment: all that a step may change.  Putting it back computes nothing that was computed before."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from discrepancy.search.state import SearchState
from discrepancy.stages.stage import Stage
from discrepancy.study.left_out import Stretch
from discrepancy.study.priors import Prior

__all__ = ["Snapshot", "ends"]

#: What a step may change: values, and lists, which are copied.
VALUES = (
    "problem",
    "given",
    "prepared",
    "in_windows_instead",
    "elimination_pending",
    "prior_conflict",
    "omnibus",
    "answer",
)
LISTS = ("stages", "decisions", "unanswered", "not_tried", "taken_back", "left_out", "priors")


class Snapshot:
    """A study at one moment.

    Parameters
    ----------
    names : tuple of str
        Of its stages.
    left_out : tuple of Stretch
    priors : tuple of Prior
    make : callable
        Returns a study as it was at that moment; called once, when more than this is wanted.
    entry : dict, optional
        The moment as a history file has it.
    """

    def __init__(
        self,
        names: Sequence[str],
        left_out: Sequence[Stretch],
        priors: Sequence[Prior],
        make: Callable[[], SearchState],
        entry: dict[str, Any] | None = None,
    ):
        self.names, self.left_out, self.priors = tuple(names), tuple(left_out), tuple(priors)
        self.entry = entry
        self._make = make
        self._values: dict[str, Any] = {}

    @classmethod
    def of(cls, study: Any) -> Snapshot:
        """Return a study as it is now."""
        taken = cls([s.name for s in study.stages], study.left_out, study.priors, lambda: study)
        taken._values = _values(study)
        return taken

    @property
    def stages(self) -> tuple[Stage, ...]:
        """Its stages; of a moment from a file they are simulated when first wanted."""
        return tuple(self["stages"])

    def __getitem__(self, name: str) -> Any:
        return self._known()[name]

    def forget_results(self, but: Sequence[Stage]) -> None:
        """Free what was computed of its stages, except of some: scores and sensitivities take much memory."""
        for stage in self._values.get("stages", ()):
            stage.forget_results(but)

    def put_back(self, study: Any) -> None:
        """Make a study what it was at this moment."""
        for name in VALUES:
            setattr(study, name, self[name])
        for name in LISTS:
            getattr(study, name)[:] = self[name]

    def differs(self) -> str:
        """Return in words how its records and priors are not those of the study file; empty where they are."""
        words = [f"without {s}" for s in self.left_out]
        for p in self.priors:
            given = "" if p.value is None else f" {p.value:.4g}"
            words.append(f"{p.name}{given}" + ("" if p.std is None else f" ± {p.std:.4g}"))
        return ", ".join(words)

    def leads_to(self, other: Snapshot) -> bool:
        """Tell whether another moment has the same stages first, from the same records and priors."""
        same = (self.left_out, self.priors) == (other.left_out, other.priors)
        return same and self.names == other.names[: len(self.names)]

    def _known(self) -> dict[str, Any]:
        if not self._values:
            self._values = _values(self._make())
        return self._values


def _values(study: Any) -> dict[str, Any]:
    values = {name: getattr(study, name) for name in VALUES}
    return values | {name: list(getattr(study, name)) for name in LISTS}


def ends(now: Snapshot, others: Sequence[Snapshot]) -> tuple[Snapshot, ...]:
    """Return the moments that end a branch of a history: those that lead neither to what is now nor to another.

    Parameters
    ----------
    now : Snapshot
    others : sequence of Snapshot
        Every other moment that is known; of several alike the first is returned.
    """
    latest: list[Snapshot] = []
    for k, moment in enumerate(others):
        later = (o for i, o in enumerate(others) if i < k or not o.leads_to(moment))
        if moment.names and not moment.leads_to(now) and not any(moment.leads_to(o) for o in later):
            latest.append(moment)
    return tuple(latest)
