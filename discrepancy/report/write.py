"""The report: one HTML page that opens offline, with its figures also as PNG files."""

from __future__ import annotations

import io
import json
import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from discrepancy.conclusion.conclusion import Conclusion, Evidence, evidence_of
from discrepancy.drawing.page import picture_address, rendered
from discrepancy.report import effect_figures, figures
from discrepancy.report.content import content
from discrepancy.report.decisions_json import save_decisions
from discrepancy.report.diagnosis_json import save_diagnosis
from discrepancy.report.schema import VERDICTS
from discrepancy.stages.residuals_along_motion import residuals_along_motion
from multibody.base.result_folder import RUN, written_together

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from discrepancy.stages.stage import Stage
    from multibody.machine.model import Model

__all__ = ["pictures", "render", "write_page", "write_report"]

_log = logging.getLogger(__name__)
_DPI = 150


@dataclass(frozen=True)
class Picture:
    """A figure of the report as PNG.

    Attributes
    ----------
    name : str
        Name of its file without the ending.
    png : bytes
    caption : str
        What it shows and how to read it.
    section : str
        Where in the page it stands.
    """

    name: str
    png: bytes
    caption: str
    section: str

    @property
    def source(self) -> str:
        """The picture as a data address for the page."""
        return picture_address(self.png)


def _picture(figure: Figure, name: str, caption: str, section: str) -> Picture:
    buffer = io.BytesIO()
    if (layout := figure.get_layout_engine()) is not None:  # once, and not again at each of the two drawings
        layout.execute(figure)
        figure.set_layout_engine("none")
    figure.savefig(buffer, format="png", dpi=_DPI, metadata={"Software": None}, pil_kwargs={"compress_level": 4})
    return Picture(name, buffer.getvalue(), caption, section)


def pictures(conclusion: Conclusion, evidence: Evidence) -> list[Picture]:
    """Draw every figure of the report."""
    worst = figures.worst_outputs(conclusion)
    drawn = [
        _picture(
            figures.falling_error(conclusion),
            "falling_error",
            "Error of the model at each step; effects are numbered as in the section below. "
            + (
                "Square marks: records held out, which no fit has seen."
                if conclusion.judged_on == "validate"
                else "No record was held out, so this is the error on the records of the fit."
            )
            + f" {figures.falling_words(conclusion)}".rstrip(),
            "falling",
        )
    ]
    for k, output in enumerate(worst[:2]):
        drawn.append(
            _picture(
                figures.over_time(conclusion, evidence, output),
                f"over_time_{k + 1}",
                f"{output} ({figures.PART_WORDS[conclusion.judged_on]}): measurement and model over time, the "
                "residual, and the worst stretch enlarged. Inside the grey band, the residual is only sensor noise.",
                "",  # beside the page, which draws the same so that it can be zoomed
            )
        )
    place = _named_place(conclusion, evidence)
    if place and conclusion.baseline.system.places:
        before = residuals_along_motion(conclusion.baseline)
        after = residuals_along_motion(conclusion.final) if conclusion.final is not conclusion.baseline else None
        if before.motions:
            drawn.append(
                _picture(
                    figures.residual_against(before, after, place, worst[0]),
                    "against_motion",
                    f"{worst[0]}: residual against speed and position at {place}. A step at zero speed is typical of "
                    "dry friction, a slope of viscous friction, a bump over position of a local fault along the path.",
                    "where",
                )
            )
    drawn.append(
        _picture(
            figures.spectra(conclusion, evidence, worst[:2]),
            "spectra",
            "Spectrum of the residual. Where a line meets the dotted one, only noise is left.",
            "where",
        )
    )
    drawn += _score_pictures(conclusion)
    shifts = effect_figures.parameter_shifts(conclusion)
    if shifts is not None:
        drawn.append(
            _picture(
                shifts,
                "parameters",
                "Shift of each parameter from its given value. A parameter far outside the grey band compensates for "
                "a missing effect.",
                "parameters",
            )
        )
    curve = conclusion.unknown
    if curve is not None:
        drawn.append(
            _picture(
                effect_figures.unknown_curve(curve),
                "unknown_force",
                "The force that would explain the error.",
                "missing",
            )
        )
    return drawn


def _named_place(conclusion: Conclusion, evidence: Evidence) -> str:
    places = {p.name for p in conclusion.final.system.places}
    named = [a.effect.where for a in conclusion.accepted if a.effect.where in places]
    if named:
        return named[0]
    return str(evidence.before.connections[0]["place"]) if evidence.before.connections else next(iter(places), "")


def _score_pictures(conclusion: Conclusion) -> list[Picture]:
    """Scores before anything was added, and after everything was."""
    drawn = []
    first, last = conclusion.baseline.scan, conclusion.final.scan
    if first is not None and first.rows:
        drawn.append(
            _picture(
                effect_figures.candidate_scores(first, title="Before anything was added"),
                "candidates_before",
                "Score of each effect on the residual of the recalibrated model. Bold: the best score. The best few "
                "were fitted in full, and the best fit was added. One missing effect raises the scores of others; that "
                "is why effects are added one at a time and all scores are computed again.",
                "else",
            )
        )
    if last is not None and last.rows and last is not first:
        drawn.append(
            _picture(
                effect_figures.candidate_scores(last, title="After everything was added"),
                "candidates_after",
                "The same after the last effect was added: bars left of their mark are not significant.",
                "hidden",
            )
        )
    return drawn


def render(conclusion: Conclusion, evidence: Evidence, drawn: list[Picture]) -> str:
    """Return the page as HTML that needs nothing from outside."""
    by_section: dict[str, list[Picture]] = {}
    for picture in drawn:
        by_section.setdefault(picture.section, []).append(picture)
    return rendered(
        "discrepancy",
        "report.html",
        pictures=by_section,
        zoomable=_in_script(figures.zoomable(conclusion, evidence)),
        **content(conclusion, evidence),
    )


def _in_script(value: Any) -> str:
    """Return a value as JSON that may stand inside a script of a page."""
    return json.dumps(value).replace("<", "\\u003c")


def write_report(
    conclusion: Conclusion, out: str | Path, evidence: Evidence | None = None, *, kind: str = "", run: str = ""
) -> list[Path]:
    """Write ``diagnosis.json``, ``report.html``, the figures as PNG and ``model.json`` into a folder, together.

    A conclusion without a verdict (compared only) goes into ``comparison.json`` instead.  Everything is written beside
    and then moved into place; ``run.json`` lists the files with their hashes.

    Parameters
    ----------
    conclusion : Conclusion
    out : path
        Made if it does not exist.
    evidence : Evidence, optional
        As computed before; else it is computed here.
    kind : str
        ``"diagnosis"`` or ``"comparison"``; default: by the verdict.
    run : str
        Identifies the model, the records and the settings.

    Returns
    -------
    list of Path
        What was written.

    Raises
    ------
    FolderTaken
        If the folder holds the results of another study, or of another kind.
    OSError
        If something cannot be written; the folder is then as before.
    """
    out = Path(out)
    judged = conclusion.verdict in VERDICTS
    evidence = evidence or evidence_of(conclusion)
    kind = kind or ("diagnosis" if judged else "comparison")
    with written_together(out, kind, conclusion.name, run) as draft:
        paths, fault = _save_model(conclusion, draft)
        reasons = (fault, evidence.before.why_no_connections, evidence.after.why_no_connections)
        faults = dict.fromkeys(f for f in reasons if f)
        conclusion = replace(conclusion, warnings=(*conclusion.warnings, *faults))
        name = "diagnosis.json" if judged else "comparison.json"
        paths.insert(0, save_diagnosis(conclusion, draft / name, evidence))
        if conclusion.models:
            paths.append(save_decisions(conclusion, draft / "decisions.json"))
        drawn = pictures(conclusion, evidence)
        page = draft / "report.html"
        page.write_text(render(conclusion, evidence, drawn), encoding="utf-8")
        paths.insert(1, page)
        for picture in drawn:
            path = draft / f"{picture.name}.png"
            path.write_bytes(picture.png)
            paths.append(path)
        names = [path.relative_to(draft) for path in paths]
    return [*(out / name for name in names), out / RUN]


def write_page(conclusion: Conclusion, path: str | Path) -> Path:
    """Write the page of a conclusion alone, with its figures in it; return its path.

    Parameters
    ----------
    conclusion : Conclusion
    path : path
        Of the page; its folder is made if it is not there.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    evidence = evidence_of(conclusion)
    path.write_text(render(conclusion, evidence, pictures(conclusion, evidence)), encoding="utf-8")
    return path


def _save_model(conclusion: Conclusion, out: Path) -> tuple[list[Path], str]:
    """Save the model of every stage; return the paths, and why they could not be saved, if so."""
    from multibody.base.errors import ModelError
    from multibody.model.storage import save

    try:
        paths = [save(_machine(conclusion.final), out / "model.json")]
        folder = out / "stages"
        folder.mkdir(exist_ok=True)
        for k, stage in enumerate(conclusion.stages):
            paths.append(save(_machine(stage), folder / f"{k}.json"))
        return paths, ""
    except ModelError as error:
        fault = f"the updated model was not saved as model.json: {error}"
        _log.warning(fault)
        return [], fault


def _machine(stage: Stage) -> Model:
    return stage.machine if stage.machine is not None else stage.model
