"""Which of the two searches a study uses."""

from __future__ import annotations

from discrepancy.search.state import SearchState

__all__ = ["is_by_evidence"]

#: States up to which "auto" searches by evidence: the machines that it was developed on have up to so many, and the
#: time of its filter grows with the cube of them.
MOST_STATES = 10


def is_by_evidence(state: SearchState) -> bool:
    """Tell whether a study searches by evidence: where it says so, or, on "auto", where that has been tried.

    That is where whole records of a small machine are simulated.  A machine with a part that steps itself is searched
    by steps.
    """
    if state.problem.model.stepped_part:  # evidence asks for states and rates
        return False
    if state.problem.search != "auto":
        return state.problem.search == "evidence"
    state.prepare()
    own_clocks = any(e.at_own_instants for e in state.problem.identify)  # the filter takes all outputs at one instant
    return state.mode == "simulation" and not own_clocks and len(state.stage.system.states) <= MOST_STATES
