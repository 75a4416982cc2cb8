"""Which of the two searches a study uses."""

from __future__ import annotations

from discrepancy.search.state import SearchState

__all__ = ["is_by_evidence"]

#: States up to which "auto" searches by evidence: the machines that it was developed on have up to so many, and the
#: time of its filter grows with the cube of them.
MOST_STATES = 10


def is_by_evidence(state: SearchState) -> bool:
    """Tell whether a study searches by evidence: where it says so, or, on "auto", where whole records are simulated."""
    if state.problem.search != "auto":
        return state.problem.search == "evidence"
    state.prepare()
    return state.mode == "simulation" and len(state.stage.system.states) <= MOST_STATES
