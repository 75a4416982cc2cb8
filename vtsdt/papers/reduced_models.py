"""Table 1 and Figs. 5 and 6 of González et al. 2020: the reference model and the reduced ones."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from discrepancy.validation.published import PaperChapter, PaperRow, claimed, compared, unchecked
from multibody.base.gravity import STANDARD_GRAVITY
from vtsdt.files.parameters import LiftParameters
from vtsdt.lift.lift import Lift
from vtsdt.papers.printed import PAPER

if TYPE_CHECKING:
    from vtsdt.lift.modes import ModesAlong

__all__ = ["drawings_chapter", "figure_5_chapter", "figure_6_chapter", "table_1_chapter"]

OWN = "the project's own bench; the paper's masses, stiffnesses and gains are not published"
#: Bars of this project for what the paper says in words.
SAME_TRIP, SAME_MODES = 1e-3, 0.01  # share of the standard deviation; share of the frequency
HIGHEST, NEAR = 60.0, 0.1  # Hz, "up to circa 60 Hz"; share within which it is "circa"
#: The cabin moves faster than this where modes are taken: at rest the regularised friction is a strong damper, m/s.
MOVING = 0.1


def drawings_chapter() -> PaperChapter:
    """Return the chapter of the figures that print no number and no curve."""
    whats = {
        "Fig. 1, elements of the framework": "a drawing of boxes; what they stand for is the packages of this project",
        "Figs. 2 and 4, Modelica models of cabin and machine": "screenshots; the same parts are components here",
        "Fig. 3, contact of guide and shoe": "a sketch of Eq. 3; the law is on the page of the guide",
        "Fig. 7, degrees of freedom of the cabin model": "a sketch; the 12 states are counted under Table 1",
    }
    rows = tuple(unchecked(what, "a drawing", "—", why) for what, why in whats.items())
    return PaperChapter(paper=PAPER, place="Figs. 1 to 4 and 7", title="drawings", rows=rows)


def table_1_chapter() -> PaperChapter:
    """Return the chapter of states and computing times."""
    made = {
        "reference": (37, 87.1, Lift.reference(profile=True)),
        "1D": (17, 11.5, Lift.one_dimensional(profile=True)),
        "cabin": (12, 9.1, Lift.cabin()),
    }
    rows: list[PaperRow] = []
    for name, (states, seconds, lift) in made.items():
        count = len(lift.system.states)
        rows.append(compared(f"states of the {name} model", states, count, 0.0, digits=0, basis="a count"))
        given: dict[str, Any] = {
            "1D": {"friction_c": -7.0, "friction_cw": 4.0},
            "cabin": {"F_c": 32.0 * STANDARD_GRAVITY},
        }.get(name, {})
        lift.trip("up", inputs=given)
        taken = []
        for _ in range(3):
            begun = time.process_time()
            lift.trip("up", inputs=given)
            taken.append(time.process_time() - begun)
        rows.append(
            unchecked(
                f"time of one 6 s simulation, {name} model",
                f"{seconds:g} s",
                f"{min(taken):.2g} s",
                "another program on another machine: compiled equations and solver here, an FMU there; processor time, "
                "least of three, compiled before, equilibrium and outputs included",
            )
        )
    support = sum(n.startswith("support.") for n in made["1D"][2].system.state_names) / 2
    rows.append(
        compared(
            "DoF of the support in the 1D model (the text says 2, the table and the count of 17 states 3)",
            3,
            support,
            0.0,
            digits=0,
            basis="a count",
        )
    )
    return PaperChapter(paper=PAPER, place="Table 1", title="reference and reduced models", rows=tuple(rows))


def figure_5_chapter(others: Sequence[LiftParameters]) -> PaperChapter:
    """Return the chapter of the 1D model against the reference.

    Parameters
    ----------
    others : sequence of LiftParameters
        Benches that the paper's figures allow as well.
    """
    from vtsdt.lift.reduction import one_dimensional_against_reference

    straight = LiftParameters.bench().straightened()
    reduction = one_dimensional_against_reference(straight)
    elsewhere = [one_dimensional_against_reference(one.straightened()).errors for one in others]
    rows = []
    for name, label in (("zdd_c", "z̈_c"), ("F_c", "F_c"), ("F_cw", "F_cw"), ("i_q", "i_q")):
        error = reduction.errors[name]
        rows.append(
            claimed(
                f"{label}: difference of the 1D model",
                "“roughly the same prediction”",
                f"{100 * error:.3f} % of its standard deviation",
                error,
                high=SAME_TRIP,
                otherwise=[errors[name] for errors in elsewhere],
                bar=f"below {100 * SAME_TRIP:g} %, a bar of this project"
                + "; on other benches "
                + ", ".join(f"{100 * errors[name]:.3f} %" for errors in elsewhere),
            )
        )
    return PaperChapter(
        paper=PAPER,
        place="Fig. 5",
        title="1D against 3D model on straight guides",
        rows=tuple(rows),
        figures={"papers_fig5": reduction.plot()},
        text="The friction of the reference model is given to the 1D model, as in the paper.",
    )


def figure_6_chapter(others: Sequence[LiftParameters]) -> PaperChapter:
    """Return the chapter of the natural frequencies along the trip; ``others`` as for `figure_5_chapter`."""
    flat, full = _along(LiftParameters.bench())
    apart, (low, high) = _apart(flat, full), _highest(flat)
    elsewhere = [_along(one) for one in others]
    rows = (
        claimed(
            "vertical modes, 1D against reference",
            "the same",
            f"{100 * apart:.2f} % apart at most",
            apart,
            high=SAME_MODES,
            otherwise=[_apart(*pair) for pair in elsewhere],
            bar=f"within {100 * SAME_MODES:g} %, a bar of this project; on other benches "
            + ", ".join(f"{100 * _apart(*pair):.2f} %" for pair in elsewhere),
        ),
        claimed(
            "highest vertical mode",
            f"“circa {HIGHEST:g} Hz”",
            f"{low:.0f} to {high:.0f} Hz",
            high,
            low=(1.0 - NEAR) * HIGHEST,
            high=(1.0 + NEAR) * HIGHEST,
            otherwise=[_highest(pair[0])[1] for pair in elsewhere],
            bar=f"the highest along the trip within {100 * NEAR:g} %, a bar of this project",
            why=OWN,
        ),
        unchecked("frequencies of each mode", "drawn, no numbers", "drawn", f"the figure prints no numbers; {OWN}"),
    )
    origins = "; ".join(f"{f:.1f} Hz: {name}" for f, name in zip(flat.vertical()[0], _origins(flat), strict=True))
    return PaperChapter(
        paper=PAPER,
        place="Fig. 6",
        title="natural frequencies over the cable's length",
        rows=rows,
        figures={"papers_fig6": _figure_6(flat, full)},
        text="Eigenvalues of the process matrix linearised along the trip up (Eq. 19), while the cabin moves. Vertical "
        f"modes of the 1D model with the cabin at the bottom, and the states that have most of each: {origins}.",
    )


def _along(parameters: LiftParameters) -> tuple[ModesAlong, ModesAlong]:
    """Modes of the 1D and of the reference model at the same instants of a trip up."""
    from vtsdt.lift.modes import modes_along_run

    full = Lift.reference(parameters, profile=True)
    run = full.trip("up")
    friction = {f"friction_{side}": (run.times, run[f"fric_{side}"]) for side in ("c", "cw")}
    flat = Lift.one_dimensional(parameters, profile=True)
    times = run.times[np.abs(run["v_c"]) > MOVING][::100]
    return modes_along_run(flat, flat.trip("up", inputs=friction), times), modes_along_run(full, run, times)


def _apart(flat: ModesAlong, full: ModesAlong) -> float:
    one, other = flat.vertical(), full.vertical()
    if one.shape != other.shape:
        return float("inf")
    return float(np.nanmax(np.abs(one / other - 1.0)))


def _highest(flat: ModesAlong) -> tuple[float, float]:
    top = flat.vertical()[:, -1]
    return float(np.nanmin(top)), float(np.nanmax(top))


_WORDS = {
    "cabin.z": "cabin",
    "counterweight.z": "counterweight",
    "pulley.angle": "pulley",
    "support.plate_position": "support, vertical",
    "support.position": "support, vertical",
    "support.tilt_A_angle": "support, φ_A",
    "support.tilt_B_angle": "support, φ_B",
}


def _origins(along: ModesAlong) -> list[str]:
    """The two coordinates that have most of each vertical mode, at the first instant."""
    modes = along.modes[0]
    names = []
    for share in modes.participation[modes.vertical]:
        by_word: dict[str, float] = {}
        for state, part in zip(modes.states, share, strict=True):
            if state in _WORDS:
                by_word[_WORDS[state]] = by_word.get(_WORDS[state], 0.0) + float(part)
        first, second = sorted(by_word, key=lambda w: -by_word[w])[:2]
        names.append(first if by_word[second] < 0.3 * by_word[first] else f"{first} with {second}")
    return names


def _figure_6(flat: ModesAlong, full: ModesAlong) -> Any:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.6, 5.0), layout="constrained")
    axis = figure.subplots()
    for k, modes in enumerate(full.modes):
        f = modes.frequency[~modes.vertical]
        f = f[f < HIGHEST]
        length = np.full(f.size, full.cable_length[k])
        axis.plot(length, f, ".", color="#bbbbbb", label="reference, lateral and rotational" if k == 0 else None)
    one, other = flat.vertical(), full.vertical()
    for k in range(other.shape[1]):
        label = "reference, vertical" if k == 0 else None
        axis.plot(full.cable_length, other[:, k], "s", color="#0072B2", fillstyle="none", markersize=5, label=label)
    below = -np.inf
    for k, name in enumerate(_origins(flat)):
        axis.plot(flat.cable_length, one[:, k], "k-", linewidth=1.0, label="1D" if k == 0 else None)
        at = max(float(one[0, k]), below + 2.2)  # Hz: labels of modes that are close do not overlap
        axis.annotate(name, (flat.cable_length[0], at), xytext=(6, 0), textcoords="offset points", va="center", size=8)
        below = at
    axis.set_xlim(right=flat.cable_length.max() + 0.8)
    axis.set_xlabel("cable length L_c [m]")
    axis.set_ylabel("natural frequency [Hz]")
    axis.set_ylim(0.0, HIGHEST)
    axis.legend(fontsize="small", ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
    return figure
