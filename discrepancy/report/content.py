"""Content of the report, section by section, as plain values for its template."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from discrepancy.conclusion.conclusion import Conclusion, Evidence
from discrepancy.conclusion.sentences import percent_words, title_of_rival
from discrepancy.effects.gain_words import gain_in_words
from discrepancy.effects.kinds import KindText, kinds
from discrepancy.questions.compare import PARTS
from discrepancy.report.diagnosis_json import effect_parameters, parameter_unit
from discrepancy.report.figures import PART_WORDS, stage_title, worst_outputs
from discrepancy.report.method_section import how, records
from discrepancy.report.wording import chance_words, interval_words, ratio_words, rival_words, share_words
from discrepancy.stages.stage import AcceptedEffect, Stage
from multibody.base.quantity_text import count_text, quantity_text, two_quantities_text, unit_text

__all__ = ["content"]

Entry = dict[str, Any]

MOST_TRIED = 15  # models of a search by evidence that the report lists; decisions.json has all
HEADLINES = {
    "effect found": "A missing effect was found",
    "nothing missing": "These records show no missing effect",
    "unknown effect": "A force is missing that no effect of the catalogue explains",
    "partly explained": "A missing effect was found, and the model still does not predict its records",
    "ambiguous": "An effect is missing; these records do not show which of several it is",
    "": "Model and records were compared; missing effects were not searched for",
}
_UNKNOWN = KindText(
    "an unidentified force",
    "A force that no entry of the catalogue explains.",
    "An effect that is not in the catalogue yet; the shape of its curve is the clue.",
    "Measure the force directly at this connection, or repeat the run and check whether the curve is the same.",
)


def kind_text(kind: str) -> KindText:
    """Return a kind in words, also for one that is not in the catalogue and for ``"kind over regressor"``."""
    name, _, over = kind.partition(" ")
    known = kinds().get(name)
    if known is not None:
        return replace(known.text, title=f"{known.text.title} ({over})") if over else known.text
    return _UNKNOWN if name == "unknown_force" else KindText(kind.replace("_", " "), "", "", "")


def _headline(conclusion: Conclusion) -> str:
    if conclusion.verdict == "nothing missing" and conclusion.final.effects:
        return "Beyond the effects added by hand, these records show no missing effect"
    return HEADLINES.get(conclusion.verdict, conclusion.verdict)


def content(conclusion: Conclusion, evidence: Evidence) -> Entry:
    """Return everything that the template shows."""
    outputs = worst_outputs(conclusion, 99)
    return {
        "title": conclusion.name or conclusion.final.model.name,
        "headline": _headline(conclusion),
        "verdict": conclusion.verdict,
        "sentence": conclusion.sentence,
        "judged_on": PART_WORDS[conclusion.judged_on],
        "held_out": conclusion.judged_on == "validate",
        "summary": _summary(conclusion, outputs),
        "compared": _compared(conclusion),
        "outputs": _outputs(conclusion),
        "table": _table(conclusion, evidence, outputs),
        "effects": [_effect(conclusion, a) for a in conclusion.accepted],
        "unknown": _unknown(conclusion),
        "where": _where(evidence, outputs),
        "where_part": PART_WORDS[evidence.before.part],
        "rivals": _rivals(conclusion),
        "hidden": _hidden(conclusion),
        "negligible": _negligible(conclusion),
        "refused": _refused(conclusion),
        "tried": _tried(conclusion),
        "next": list(conclusion.next_measurement),
        "separating": list(conclusion.extra.get("separating_trips", ())),
        "parameters": _parameters(conclusion),
        "confounded": [", ".join(g) for g in conclusion.final.identify.confounded],
        "records": records(conclusion),
        "warnings": list(conclusion.warnings),
        "how": how(conclusion),
    }


def _summary(conclusion: Conclusion, outputs: list[str]) -> Entry:
    """Return what the first screen shows: how sure the answer is, the error before and after, and what to do."""
    accepted, part = conclusion.accepted, conclusion.judged_on
    sure = []
    for a in accepted:
        title = f"{kind_text(a.effect.kind).title} at {a.effect.where}"
        words = _evidence(conclusion, a) or f"{_sentence(chance_words(a.p_value))}, over all effects that were tested."
        sure.append(f"{_sentence(title)}: {words[0].lower()}{words[1:]}" if len(accepted) > 1 else words)
        tied = [title_of_rival(r) for r in a.rivals if r.indistinguishable]
        if tied:
            sure.append(f"These records cannot distinguish it from: {'; '.join(tied)}.")
    old, new = conclusion.baseline.rmse(part), conclusion.final.rmse(part)
    bars = []
    for output in outputs[:6]:
        unit = conclusion.final.system.unit(output)
        ratio = new[output] / old[output] if old[output] > 0.0 else 1.0
        changed, differs = conclusion.final is not conclusion.baseline, abs(ratio - 1.0) >= 0.005
        before, after = two_quantities_text(old[output], new[output], unit)
        bars.append(
            {
                "output": output,
                "before": before,
                "after": after if changed else "",
                "width": f"{100.0 * min(1.0, ratio):.0f}",
                "change": f"{100.0 * (ratio - 1.0):+.0f} %".replace("-", "−") if differs else "unchanged",
                "worse": differs and ratio > 1.0,
            }
        )
    measure = list(conclusion.next_measurement)[:2]
    todo = [
        f"{_sentence(kind_text(a.effect.kind).title)}: {kind_text(a.effect.kind).confirm}"
        for a in accepted
        if not any(kind_text(a.effect.kind).confirm in text for text in measure)
    ]
    if conclusion.verdict == "unknown effect":
        todo.append(_UNKNOWN.confirm)
    todo += measure
    if not todo and conclusion.verdict:
        todo.append("Nothing: the model explains these records as well as their sensors allow to tell.")
    if not conclusion.verdict:
        todo.append("Run vtsdt diagnose with the same study to find what the model lacks.")
    return {"sure": sure, "bars": bars, "todo": todo}


def _sentence(text: str) -> str:
    """Return a text that begins with a capital letter."""
    return text[:1].upper() + text[1:]


def _compared(conclusion: Conclusion) -> str:
    fits = {part: conclusion.final.fits(part) for part in PARTS}
    text = (
        f"The model '{conclusion.final.model.name}' was compared with {count_text(len(fits['identify']), 'record')} "
        f"({_seconds(fits['identify'])}) used for fitting"
    )
    if fits["validate"]:
        purpose = (
            "They were used neither to fit parameters nor to choose effects, only to verify."
            if conclusion.probabilities is None
            else "They were not used to fit parameters, but an effect that they do not confirm is not announced."
        )
        return text + (
            f" and {count_text(len(fits['validate']), 'record')} ({_seconds(fits['validate'])}) held out. {purpose}"
        )
    return text + (
        ". No record was held out, so the result cannot be verified on records that were not used to find it; hold one "
        "out if possible."
    )


def _seconds(fits: Any) -> str:
    total = sum(float(f.experiment.time[-1] - f.experiment.time[0]) for f in fits)
    return f"{total:.3g} s"


def _outputs(conclusion: Conclusion) -> list[Entry]:
    system, noise = conclusion.final.system, conclusion.baseline.noise
    columns = conclusion.final.identify.fits[0].experiment.record.signals
    return [
        {
            "name": n,
            "column": columns[n].column if n in columns else "",
            "noise": quantity_text(noise.get(n), system.unit(n)) if noise.get(n) else "not known",
        }
        for n in conclusion.final.outputs
    ]


def _table(conclusion: Conclusion, evidence: Evidence, outputs: list[str]) -> list[Entry]:
    """Errors stage by stage, a row for each output."""
    stages, number = [], 0
    for stage, comparison in zip(conclusion.stages, evidence.comparisons, strict=True):
        pooled = {part: comparison.pooled(part) for part in PARTS}
        rows = []
        for output in outputs:
            cells: Entry = {"output": output}
            noise = stage.noise.get(output)
            for part in PARTS:
                a = pooled[part].get(output)
                cells[part] = "" if a is None else quantity_text(a.rmse, stage.system.unit(output))
                cells[f"{part}_share"] = "" if a is None or not math.isfinite(a.nrmse) else share_words(a.nrmse)
            a = pooled[conclusion.judged_on].get(output)
            cells["over_noise"] = f"{quantity_text(a.rmse / noise, digits=2)} ×" if a is not None and noise else ""
            rows.append(cells)
        number += stage.accepted is not None
        title = stage_title(stage) + (f" (effect {number})" if stage.accepted is not None else "")
        stages.append({"name": title, "rows": rows})
    return stages


# ---------------------------------------------------------------- effects


def _effect(conclusion: Conclusion, accepted: AcceptedEffect) -> Entry:
    effect, final = accepted.effect, conclusion.final
    text = kind_text(effect.kind)
    sizes = []
    if not effect.definition.free_form:
        for name, entry in effect_parameters(effect, final).items():
            full = effect.parameter_name(name)
            if full in final.identify.to_dict():
                low, high = final.identify.interval(full)
                size = interval_words(entry["value"], low, high, parameter_unit(effect, name, final))
                if name == "gain" and (words := gain_in_words(entry["value"], low, high)):
                    size += f": {words}"
            else:
                size = quantity_text(entry["value"], entry["unit"])
            if effect.definition.stated:
                given = conclusion.stages[0]
                stated = float(given.p[given.system.index("parameter", full)])
                size += f"; the model states {quantity_text(stated, entry['unit'])}"
            sizes.append({"name": _words(name), "text": size})
    stage = next(
        s
        for s in conclusion.stages
        if s.accepted is not None
        and str(s.accepted.effect) == str(effect)
        and s.accepted.effect.number == effect.number
    )
    before = conclusion.stages[conclusion.stages.index(stage) - 1]
    return {
        "title": text.title,
        "where": effect.where,
        "kind": effect.kind,
        "what": text.what,
        "causes": text.causes,
        "confirm": text.confirm,
        "sizes": sizes,
        "chance": chance_words(accepted.p_value),
        "p_value": f"{accepted.p_value:.2g}",
        "delta_bic": f"{accepted.delta_bic:.0f}",
        "evidence": _evidence(conclusion, accepted),
        "masked_by": _masked_by(conclusion, accepted),
        "changes": _error_changes(conclusion, before, stage),
        "ambiguous": accepted.ambiguous,
        "tied": [title_of_rival(r) for r in accepted.rivals if r.indistinguishable],
    }


def _evidence(conclusion: Conclusion, accepted: AcceptedEffect) -> str:
    """Return the probability of an effect and the gain of log evidence, for a search by evidence; else nothing."""
    if conclusion.probabilities is None:
        return ""
    name = str(accepted.effect)
    own = next((e for e in conclusion.probabilities.effects if f"{e.kind}@{e.where}" == name), None)
    parts = [f"The log evidence of the model rises by {-0.5 * accepted.delta_bic:.0f} with it."]
    if own is not None:
        parts.insert(0, f"Its probability is {percent_words(own.probability)}.")
    return " ".join(parts)


def _tried(conclusion: Conclusion) -> list[Entry]:
    """Return the models of a search by evidence, best first, with the reason why each was taken or not."""
    known = sorted((m for m in conclusion.models if math.isfinite(m.total)), key=lambda m: -m.total)
    taken = next((m.total for m in known if m.taken), known[0].total if known else 0.0)
    return [
        {
            "effects": "; ".join(m.key) or "no effect",
            "evidence": f"{m.total - taken:+.1f}",
            "outcome": "taken" if m.taken else m.outcome,
            "taken": m.taken,
        }
        for m in known[:MOST_TRIED]
    ]


def _masked_by(conclusion: Conclusion, accepted: AcceptedEffect) -> Entry | None:
    """Return the other effect of a masking pair, and the improvement by both together."""
    other = next((a for a in conclusion.accepted if str(a.effect) == accepted.masked_by), None)
    if other is None:
        return None
    title = f"{kind_text(other.effect.kind).title} at {other.effect.where}"
    return {"title": title, "delta_bic": f"{accepted.delta_bic + other.delta_bic:.0f}"}


def _words(name: str) -> str:
    known = {
        "coulomb": "friction",
        "viscous": "friction per speed",
        "forward": "forwards",
        "backward": "backwards",
        "v_stribeck": "speed at which it fades",
        "v_s": "speed within which it builds up",
        "share": "share of the load",
        "x_s": "displacement before it slides",
        "cosine": "cosine part",
        "sine": "sine part",
        "place": "place of its middle",
        "push": "force",
    }
    return known.get(name, name.replace("_", " "))


def _error_changes(conclusion: Conclusion, before: Stage, after: Stage) -> list[str]:
    part = conclusion.judged_on
    old, new = before.rmse(part), after.rmse(part)
    changes = []
    for output in worst_outputs(conclusion, 99):
        unit = after.system.unit(output)
        was, now = two_quantities_text(old[output], new[output], unit)
        changes.append(f"{output}: error {ratio_words(old[output], new[output])}, from {was} to {now}")
    return changes


def _unknown(conclusion: Conclusion) -> Entry | None:
    curve = conclusion.unknown
    if curve is None:
        return None
    text = kind_text("unknown_force")
    return {
        "where": curve.where,
        "statement": curve.statement,
        "over": curve.regressor,
        "chance": chance_words(curve.p_value),
        "what": text.what,
        "causes": text.causes,
        "confirm": text.confirm,
        "listed": any(a.effect.kind == "unknown_force" for a in conclusion.accepted),
    }


def _rivals(conclusion: Conclusion) -> list[Entry]:
    tables = []
    for accepted in conclusion.accepted:
        rows = [
            {
                "title": " with ".join(kind_text(n.partition("@")[0]).title for n in r.names),
                "where": " and ".join(n.partition("@")[2] for n in r.names),
                "comparison": rival_words(r),
                "delta": f"{r.delta_bic:+.0f}" if math.isfinite(r.delta_bic) else "",
                "tied": r.indistinguishable,
            }
            for r in accepted.rivals[:8]
        ]
        tables.append({"title": kind_text(accepted.effect.kind).title, "where": accepted.effect.where, "rows": rows})
    return tables


def _hidden(conclusion: Conclusion) -> Entry:
    seen: list[Entry] = []
    blind: list[Entry] = []
    for kind, where, mde, delta, unit in conclusion.hidden:
        if not unit and kind.endswith("_gain"):
            mde, delta, unit = 100.0 * mde, 100.0 * delta, "%"
        row = {
            "title": kind_text(kind).title,
            "where": where,
            "mde": quantity_text(mde, unit, 2),
            "delta": quantity_text(delta, unit, 2),
        }
        (seen if mde < delta else blind).append(row)
    for rows in (seen, blind):
        rows.sort(key=lambda r: (r["title"], r["where"]))
    scatter = conclusion.extra.get("could_hide_scatter")
    return {"seen": seen, "blind": blind, "scatter": share_words(scatter) if scatter else ""}


def _negligible(conclusion: Conclusion) -> list[Entry]:
    rows = []
    for kind, where, size, std, p, unit in conclusion.negligible:
        strength = f"{quantity_text(size, unit)} ± {quantity_text(std, unit, 2)}"
        rows.append({"title": kind_text(kind).title, "where": where, "size": strength, "chance": chance_words(p)})
    return rows


def _refused(conclusion: Conclusion) -> list[Entry]:
    """Group what could not be examined by the reason, which many share."""
    by_reason: dict[str, list[str]] = {}
    for kind, where, why in conclusion.refused:
        by_reason.setdefault(why, []).append(f"{kind_text(kind).title} at {where}")
    return [{"why": why, "names": names} for why, names in by_reason.items()]


# ---------------------------------------------------------------- where, parameters


def _where(evidence: Evidence, outputs: list[str]) -> list[Entry]:
    """Where the recalibrated model fails; regimes and curves of the worst output only, since others repeat it."""
    lists = evidence.before.to_dict()
    worst = outputs[0] if outputs else ""
    sections = []
    for name, heading, most in (
        ("signals", "In which signal", 6),
        ("regimes", "When", 5),
        ("dependence", "Along what", 4),
        ("frequencies", "At which frequencies", 4),
        ("connections", "At which connection", 6),
    ):
        entries = [e for e in lists[name] if name in ("signals", "connections") or e.get("output") == worst]
        if entries:
            sections.append({"heading": heading, "sentences": [e["sentence"] for e in entries[:most]]})
    return sections


def _parameters(conclusion: Conclusion) -> list[Entry]:
    base, final = conclusion.baseline.identify, conclusion.final.identify
    frame = final.to_frame()
    recalibrated = base.to_dict()
    own = {name for a in conclusion.accepted for name in a.effect.parameters()}
    rows = []
    for p in final.parameters:
        if p.name in own:
            continue
        low, high = final.interval(p.name)
        interval, uncertain, _ = interval_words(final[p.name], low, high, "").partition(": these records hardly")
        interval += ")" if uncertain else ""
        remark = str(frame.loc[p.name, "remark"])
        if math.isfinite(p.std) and p.std > 0.0 and abs(final[p.name] - p.value) > 3.0 * p.std:
            remark = "; ".join(filter(None, [remark, "more than three standard deviations from the value given"]))
        if uncertain:
            remark = "; ".join(filter(None, [remark, "hardly determined by these records"]))
        rows.append(
            {
                "name": p.name,
                "unit": unit_text(p.unit),
                "given": quantity_text(p.value, "", 4),
                "prior": f"± {quantity_text(p.std, '', 2)}" if math.isfinite(p.std) else "free",
                "recalibrated": quantity_text(recalibrated[p.name], "", 4) if p.name in recalibrated else "",
                "final": interval.replace("95 % interval ", ""),
                "remark": remark,
            }
        )
    return rows
