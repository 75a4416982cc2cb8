"""From the stages of a study to its conclusion: the verdict, what could still hide, and what to measure next."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from discrepancy.effects.effect import unit_at
from discrepancy.effects.kinds import kind_named
from discrepancy.questions.next_measurement import next_measurements
from discrepancy.questions.unknown_force import describe_unknown
from discrepancy.questions.unnamed_force import nameless_force
from discrepancy.report.conclusion import Conclusion, UnknownCurve, explained
from discrepancy.report.wording import rival_title
from discrepancy.residual.input_noise import noise_summary
from discrepancy.search.parameter_trend import Trend, parameter_trends
from discrepancy.sensitivities.input_feedback import feedback_messages, inputs_with_feedback
from discrepancy.stages.prior_conflict import conflict_text, prior_conflicts
from discrepancy.stages.stage import AcceptedEffect, Stage
from discrepancy.statistics.verdicts import Verdict
from multibody.base.quantity_text import quantity_text

if TYPE_CHECKING:
    from discrepancy.study.study import Study

__all__ = ["conclude"]

# Times its noise, and share of its spread, from which the report says that an error is large: chosen, not measured.
LOUD, VISIBLE = 10.0, 0.1

# Effects that change too little, of which the report tells as many.
SLIGHT = 3

_NUMBER = {1: "one effect", 2: "two effects", 3: "three effects"}


def conclude(study: Study) -> Conclusion:
    """Return what a study found, in words and figures."""
    problem, stages = study.problem, tuple(study.stages)
    accepted = [s.accepted for s in stages if s.accepted is not None]
    verdict = _verdict(accepted)
    unknown = described = None
    if any(a.effect.definition.free_form for a in accepted):
        entry = next(a for a in reversed(accepted) if a.effect.definition.free_form)
        effect = next(e for e in stages[-1].effects if e.component_name == entry.effect.component_name)
        described = study.unless_it_fails("what the unknown force depends on", lambda: describe_unknown(study))
        statement = " ".join([_curve_words(entry), *([described.sentence] if described is not None else [])])
        unknown = UnknownCurve.of_effect(
            effect, stages[-1].identify, statement, p_value=entry.p_value, delta_bic=entry.delta_bic
        )
    still = None if accepted else study.follows
    nameless = None
    if still is not None:
        nameless = study.unless_it_fails("where the missing force acts", lambda: nameless_force(study))
    if nameless is not None:
        unknown, described = nameless
        verdict = "unknown effect"
    refused, hidden = _left_over(study)
    slight = _slight(study)
    separating = study.unless_it_fails("what to measure next", lambda: next_measurements(study)) or ()
    warnings = problem.warnings
    if study.beyond is not None and accepted:
        warnings = (*warnings, study.beyond.told(f"{_title(accepted[0].effect.kind)} at {accepted[0].effect.where}"))
    if not accepted and (far := prior_conflicts(stages[-1].identify)):
        listed = " and ".join(conflict_text(q, value) for q, value in far)
        warnings = (*warnings, f"Calibration ends outside what was stated: {listed}. Check what was stated.")
    noisy = study.prepared.noisy if study.prepared is not None else ()
    reacting = _reacting(study)
    warnings = (*warnings, *(n.sentence for n in noisy), *feedback_messages(reacting))
    disturbance = stages[-1].disturbance
    warnings = (*warnings, *([disturbance.sentence] if disturbance is not None else []))
    trends = study.unless_it_fails("whether parameters change along the records", lambda: _trends(study)) or ()
    warnings = (*warnings, *(t.sentence for t in trends))
    warnings = (*warnings, *_not_lasting(stages), *dict.fromkeys(study.troubles))
    if study.interrupted:
        warnings = (*warnings, "The search was interrupted: there may be more to find than what stands here.")
        verdict = verdict if accepted else ""
    paths = [str(problem.path)] if problem.path is not None else []
    paths += [str(e.record.path) for e in (*problem.identify, *problem.validate)]
    found = Conclusion(
        verdict=verdict,
        sentence="",
        stages=stages,
        refused=refused,
        hidden=hidden,
        slight=slight,
        next_measurement=(*(s.sentence for s in separating), *_next(accepted, hidden, study)),
        unknown=unknown,
        warnings=warnings,
        residual_mode=study.mode,
        residual_reason=study.mode_reason,
        seed=problem.seed,
        level=problem.level,
        name=problem.name,
        paths=tuple(paths),
        extra={
            "separating_trips": [s.to_dict() for s in separating],
            **({"unknown": described.to_dict()} if described is not None else {}),
            **({"noisy_inputs": [n.to_dict() for n in noisy]} if noisy else {}),
            **({"reacting_inputs": reacting} if reacting else {}),
            **({"disturbance": disturbance.to_dict()} if disturbance is not None else {}),
            **({"parameter_trends": [t.to_dict() for t in trends]} if trends else {}),
            **({"follows_inputs": {"p": still.p, "rejects": still.rejects, "most": still.leading}} if still else {}),
        },
    )
    more = [noise_summary(noisy)] if noisy else []
    if unknown is not None and not accepted:
        return replace(found, sentence=" ".join([unknown.statement + _far_off(stages[-1]), *more]))
    sentence = _sentence(found, accepted) + _far_off(stages[-1])
    return replace(found, sentence=" ".join([sentence, *([still.sentence] if still is not None else []), *more]))


def _reacting(study: Study) -> dict[str, str]:
    """Return the recorded inputs that answer to what is left, if a search has asked for that at all."""
    if study.mode == "inverse" or not study.steps:  # where motion is given, it is an input
        return {}
    stage = study.stages[-1]
    return inputs_with_feedback(stage.linearised_problem())


def _trends(study: Study) -> tuple[Trend, ...]:
    """Return the parameters that change along the records, if a search has asked for anything at all."""
    if not study.steps:
        return ()
    return parameter_trends(study.stages[-1], study.problem.level, study.problem.seed)


def _verdict(accepted: Sequence[AcceptedEffect]) -> str:
    if not accepted:
        return "nothing missing"
    if any(a.effect.definition.free_form for a in accepted):
        return "unknown effect"
    pairs = any(r.indistinguishable and len(r.names) > 1 for a in accepted for r in a.rivals)
    return "ambiguous" if pairs or any(a.ambiguous for a in _last(accepted)) else "effect found"


def _title(kind: str) -> str:
    return kind_named(kind.split(" ")[0]).text.title


def _sentence(found: Conclusion, accepted: Sequence[AcceptedEffect]) -> str:
    stages, hidden = found.stages, found.hidden
    if not accepted:
        small = _slight_words(found)
        could = [f"{_title(k)} at {w}" for k, w, mde, delta, _ in hidden if not (mde < delta < math.inf)]
        base = "Nothing was found that the model lacks" + (" and that would matter" if small else "")
        if not could:
            return f"{base}; every effect in the catalogue that would matter would have been seen.{small}"
        many = f"{len(could)} effects of a size that would matter, {could[0]} among them"
        return f"{base}.{small} These records could still hide {many}."
    names = [f"{_title(a.effect.kind)} at {a.effect.where}" for a in accepted]
    count = _NUMBER.get(len(names), f"{len(names)} effects")
    text = f"The model lacks {count}: {'; '.join(names)}."
    part = "validate" if stages[-1].validate is not None else "identify"
    text += _fall(stages[1], stages[-1], part) + _instead(stages[1], stages[-1])
    for first, second in pairwise(zip(accepted, names, strict=True)):
        if first[0].hidden_by == str(second[0].effect):
            text += f" {first[1].capitalize()} and {second[1]} hide each other: either alone changes little."
    text += f" {100 * explained(found)[0]:.0f} % of the mean square error above the noise floor is gone."
    return text + _tied_words(accepted, names)


def _tied_words(accepted: Sequence[AcceptedEffect], names: Sequence[str]) -> str:
    """Say what else the last effect could be that leaves the verdict open, or two effects of the story together."""
    for k in reversed(range(len(accepted))):
        a = accepted[k]
        pair = bool(a.masked_by) and k > 0 and a.masked_by == str(accepted[k - 1].effect)
        for r in a.rivals:
            two = len(r.names) > 1
            if r.indistinguishable and r.kind != a.effect.kind and (two or a in _last(accepted)):
                told = " with ".join(names[k - 1 : k + 1] if pair else names[k : k + 2]) if two else names[k]
                return f" These records cannot tell {told} from {rival_title(r)}."
    return ""


def _last(accepted: Sequence[AcceptedEffect]) -> Sequence[AcceptedEffect]:
    """Return the last effect, or the last two where they hide each other."""
    return accepted[-2:] if accepted[-1].masked_by else accepted[-1:]


def _slight_words(found: Conclusion) -> str:
    if not found.slight:
        return ""
    kind, where, size, std, p, unit = found.slight[0]
    strength = f"{quantity_text(size, unit)} ± {quantity_text(std, unit, 2)}, p = {p:.1g}"
    return (
        f" {_title(kind).capitalize()} at {where} shows ({strength}), but what it changes in the calibrated model "
        "stays below the noise floor of every output."
    )


def _fall(before: Stage, after: Stage, part: str) -> str:
    """Say how far the error of the output that fell most has fallen."""
    a, b = before.rmse(part), after.rmse(part)
    name = min(b, key=lambda n: b[n] / a[n] if a[n] > 0 else 1.0)
    held = "on records that were not used to find it" if part == "validate" else "on the records used to find it"
    unit = after.system.unit(name)
    them = "it" if len(after.effects) == 1 else "them"
    before_text, after_text = quantity_text(a[name], unit), quantity_text(b[name], unit)
    return f" With {them} the error of {name} falls from {before_text} to {after_text} {held}."


def _not_lasting(stages: Sequence[Stage]) -> list[str]:
    """Say which effects lower the error of no output on the records that were held out."""
    found = []
    for before, after in pairwise(stages):
        if after.accepted is None or after.validate is None or after.half_of_masking_pair:
            continue
        a, b = before.rmse("validate"), after.rmse("validate")
        if all(b[n] >= a[n] for n in b):
            name = f"{_title(after.accepted.effect.kind)} at {after.accepted.effect.where}"
            found.append(
                f"{name.capitalize()} lowers the error on the records used to find it, but of no output on those held "
                "out: do not trust it."
            )
    return found


def _far_off(stage: Stage) -> str:
    """Say that a model does not follow its records, if it does not: then much can hide in what is left."""
    error, shares = stage.rmse("identify"), {}
    for c, name in enumerate(stage.outputs):
        spread = float(np.std(np.concatenate([f.experiment.measured[:, c] for f in stage.identify.fits])))
        if 0.0 < VISIBLE * spread < error[name] and error[name] > LOUD * stage.noise.get(name, 0.0):
            shares[name] = error[name] / spread
    if not shares:
        return ""
    name = max(shares, key=lambda n: shares[n])
    return (
        f" The model does not follow these records: {name} is off by {100.0 * shares[name]:.0f} % of its spread. "
        "Something is missing or wrong that was not found."
    )


def _instead(before: Stage, after: Stage) -> str:
    """Say which parameters calibration takes out of their stated uncertainty where the effects are not in the model."""
    within = {q.name for q in after.identify.parameters} - {q.name for q, _ in prior_conflicts(after.identify)}
    far = [conflict_text(q, value) for q, value in prior_conflicts(before.identify) if q.name in within]
    without = "it" if len(after.effects) == 1 else "them"
    return f" Without {without} the records ask for {' and '.join(far)}." if far else ""


def _curve_words(entry: AcceptedEffect) -> str:
    level = "a dry friction whose level follows the position"
    over = level if entry.effect.over == "friction" else f"a function of {entry.effect.over}"
    rivals = [r for r in entry.rivals if r.indistinguishable]
    alias = f" These records do not tell it from {rivals[0].kind}." if rivals else ""
    where = entry.effect.where
    return f"The missing force at {where} is best described as {over}; no law of the catalogue fits as well.{alias}"


def _left_over(
    study: Study,
) -> tuple[tuple[tuple[str, str, str], ...], tuple[tuple[str, str, float, float, str], ...]]:
    """Return what the last scan could not speak about, and what it looked for without finding it."""
    if not study.steps:
        return (), ()
    step = study.steps[-1]
    present = {(e.kind, e.where) for e in study.stages[-1].effects}
    refused = [(e.kind.name, e.where, why) for e, why in step.refused]
    for name, why in step.scan.refused.items():
        kind, _, where = name.partition("@")
        if (kind, where) not in present:
            refused.append((kind, where, why))
    unseen = (Verdict.ABSENT, Verdict.CANNOT_TELL)
    hidden = [
        (
            r.kind,
            r.where,
            float(r.smallest_visible_strength),
            float(r.strength_that_matters),
            unit_at(study.stage.system, r.kind, r.where),
        )
        for r in step.scan.rows
        if r.verdict in unseen and (r.kind, r.where) not in present
    ]
    return tuple(refused), tuple(hidden)


def _slight(study: Study) -> tuple[tuple[str, str, float, float, float, str], ...]:
    """Return what the last step has found and passed over, because it changes too little."""
    if not study.steps:
        return ()
    step = study.steps[-1]
    present = {(e.kind, e.where) for e in study.stages[-1].effects}
    sure = {r.name: r for r in (*step.scan.rows, *step.slight) if r.verdict is Verdict.NEGLIGIBLE or r in step.slight}
    found = []
    for r in sorted(sure.values(), key=lambda r: r.delta_bic)[:SLIGHT]:
        if (r.kind, r.where) not in present and r.delta_bic < 0.0:
            most = int(np.argmax(np.abs(r.expected_strength)))
            size, std = float(r.expected_strength[most]), float(r.standard_error[most])
            found.append((r.kind, r.where, size, std, float(r.p_value), unit_at(study.stage.system, r.kind, r.where)))
    return tuple(found)


def _next(
    accepted: Sequence[AcceptedEffect], hidden: Sequence[tuple[str, str, float, float, str]], study: Study
) -> tuple[str, ...]:
    found = []
    for a in accepted:
        for r in a.rivals:
            if r.indistinguishable and r.kind != a.effect.kind:
                other = kind_named(r.kind.split(" ")[0]).text.confirm
                found.append(
                    f"To tell {_title(a.effect.kind)} at {a.effect.where} from {rival_title(r)}: "
                    f"{kind_named(a.effect.kind).text.confirm} For the other: {other}"
                )
            elif r.indistinguishable and r.where != a.effect.where:
                found.append(
                    f"{_title(a.effect.kind).capitalize()} at {a.effect.where} and at {r.where} look the same to these "
                    "sensors: measure the force between the two places, or separate them and repeat."
                )
    weak = sorted((h for h in hidden if not h[2] < h[3] < math.inf), key=lambda h: -h[2] / max(h[3], 1e-300))
    if weak and not accepted:
        kind, where, mde, delta, unit = weak[0]
        found.append(
            f"To rule out {_title(kind)} at {where} (now seen above {quantity_text(mde, unit)}, and it would matter "
            f"above {quantity_text(delta, unit)}): {kind_named(kind).text.confirm}"
        )
    if study.stages[-1].validate is None:
        found.append("Hold a record back ([records] validate): without one nobody knows whether the improvement lasts.")
    return tuple(dict.fromkeys(found))[:6]
