"""From the state of a search to its conclusion: verdict, sentences, what could still hide, what to measure next."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from discrepancy.conclusion.conclusion import Conclusion, HiddenEffect, NegligibleEffect, RefusedEffect
from discrepancy.conclusion.sentences import (
    Unconfirmed,
    answer,
    check_sentence,
    curve_statement,
    laws_of_curve_sentence,
    listed,
    manual_checks,
    outputs_far_above_noise,
    poor_fit_note,
    probability_sentence,
    stopped_early_warnings,
    time_limit_sentence,
    time_limit_warnings,
    title_of,
    title_of_name,
    verdict_of,
    warnings_about_effects,
)
from discrepancy.effects.effect import unit_at
from discrepancy.evidence.checks import Check, checks_by_output, predictive_checks
from discrepancy.evidence.moves import key_of
from discrepancy.evidence.posterior import Posterior, posterior
from discrepancy.evidence.random_forces import RandomForces, random_forces_of, slow_force_sentence
from discrepancy.evidence.search import EvidenceSearch
from discrepancy.evidence.uneven_forces import UnevenForce, uneven_random_forces
from discrepancy.evidence.unknown_law import UnknownLaw
from discrepancy.questions.next_measurement import next_measurements
from discrepancy.questions.parameter_trend import Trend, parameter_trends
from discrepancy.questions.unknown_force import (
    UnknownCurve,
    UnknownForce,
    describe_accepted_curve,
    find_unidentified_force,
)
from discrepancy.residual.input_noise import noise_summary
from discrepancy.search.omnibus import Omnibus, omnibus_of_stage
from discrepancy.search.state import SearchState
from discrepancy.sensitivities.disturbance import DisturbanceForce
from discrepancy.sensitivities.input_feedback import feedback_messages, inputs_with_feedback
from discrepancy.stages.prior_conflict import conflict_text, prior_conflicts
from discrepancy.stages.stage import AcceptedEffect, Stage
from discrepancy.statistics.thresholds import LEVEL_SHARES
from discrepancy.statistics.verdicts import Verdict

__all__ = ["conclude"]

MOST_NEGLIGIBLE = 3  # effects that are present but change too little, of which the report lists as many


def conclude(state: SearchState, by_evidence: EvidenceSearch | None = None) -> Conclusion:
    """Return the conclusion of a search, or of a comparison where nothing was searched.

    Parameters
    ----------
    state : SearchState
    by_evidence : EvidenceSearch, optional
        That made the stages, if it was such a search.
    """
    problem, stages = state.problem, tuple(state.stages)
    last = stages[-1]
    accepted = [s.accepted for s in stages if s.accepted is not None]
    verdict = verdict_of(accepted)
    curve, force = _accepted_curve(state, accepted, stages)
    omnibus = None if accepted else state.omnibus
    unidentified = None
    if omnibus is not None:
        unidentified = state.if_simulated("where the missing force acts", lambda: find_unidentified_force(state))
    if unidentified is not None:
        curve, force = unidentified
        verdict = "unknown effect"
    checks = _checks(state, by_evidence)
    failed = [c for c in checks if not c.passed]
    uneven = _uneven(state, by_evidence)
    law = _unknown_law(by_evidence)
    follows = law is not None and law.announced
    unconfirmed = _unconfirmed(state, by_evidence) if not accepted else None
    if failed or uneven or follows or unconfirmed is not None:
        verdict = "unknown effect" if not accepted or verdict == "unknown effect" else "partly explained"
    elif verdict in ("effect found", "ambiguous") and poor_fit_note(last, verdict):
        verdict = "partly explained"
    likelihood = by_evidence.likelihood if by_evidence is not None else None
    forces = random_forces_of(likelihood) if likelihood is not None else None
    slow = _slow_force(forces, last) if by_evidence is not None and not accepted else ""
    if slow or (state.decisions and not accepted and poor_fit_note(last, verdict)):
        # what the noise model takes for a random force is too large to be left without a word
        verdict = "unknown effect"
    if by_evidence is not None and not accepted and verdict == "unknown effect":
        described = state.if_simulated("where the missing force acts", lambda: _force_that_follows_inputs(state))
        curve, force = described or (curve, force)
    refused, hidden = _not_found(state)
    negligible = _negligible(state)
    trips = state.if_simulated("what to measure next", lambda: next_measurements(state)) or ()
    by_hand = manual_checks(stages, hidden)  # they say more than a measurement without a trip to propose
    trips = tuple(t for t in trips if t.proposals or not any(c.startswith(f"{t.purpose}:") for c in by_hand))
    noisy = state.prepared.noisy if state.prepared is not None else ()
    feedback = _inputs_with_feedback(state)
    disturbance: DisturbanceForce | RandomForces | None = forces or last.disturbance
    trends = state.if_simulated("whether parameters change along the records", lambda: _trends(state)) or ()
    warnings = [
        *problem.warnings,
        *stopped_early_warnings(last),
        *_prior_conflict_warnings(state, accepted),
        *(n.sentence for n in noisy),
        *feedback_messages(feedback),
        *(remark for remark in state.remarks if remark not in problem.warnings),
        *([disturbance.sentence] if disturbance is not None else []),
        *(t.sentence for t in trends),
        *warnings_about_effects(stages),
        *dict.fromkeys(state.unanswered),
        *time_limit_warnings(state.not_tried),
    ]
    if state.interrupted:
        by = f" ({state.interruption})" if state.interruption not in ("", "interrupted") else ""
        warnings.append(f"The search was interrupted{by}: there may be more effects than those listed here.")
        warnings += [state.untested] if state.untested else []
        verdict = verdict if accepted else ""
    judged_on = "validate" if stages[min(1, len(stages) - 1)].fits("validate") else "identify"
    if curve is not None and not accepted and unconfirmed is None:
        sentences = [curve.statement + poor_fit_note(last, verdict)]
    else:
        said = answer(stages, hidden, negligible, judged_on, verdict, unconfirmed)
        sentences = [said + poor_fit_note(last, verdict)]
        sentences += [omnibus.sentence] if omnibus is not None else []
    sentences += _nearest_laws(state, by_evidence)
    sentences += [law.sentence] if law is not None and follows else []
    sentences += [u.sentence for u in uneven]
    sentences += [slow] if slow else []
    sentences += [check_sentence(failed)] if failed else []
    probabilities = _probabilities(by_evidence, verdict)
    sentences += [probability_sentence(probabilities)] if probabilities is not None else []
    sentences += [noise_summary(noisy)] if noisy else []
    sentences += [time_limit_sentence(problem.time_limit)] if state.not_tried else []
    paths = [str(problem.path)] if problem.path is not None else []
    paths += [str(e.record.path) for e in (*problem.identify, *problem.validate)]
    extra: dict[str, Any] = {"separating_trips": [t.to_dict() for t in trips]}
    if hidden and state.decisions:
        extra["could_hide_scatter"] = state.decisions[-1].scan.visible_scatter
    if force is not None:
        extra["unknown"] = force.to_dict()
    if noisy:
        extra["noisy_inputs"] = [n.to_dict() for n in noisy]
    if feedback:
        extra["reacting_inputs"] = feedback
    if disturbance is not None:
        extra["disturbance"] = disturbance.to_dict()
    if trends:
        extra["parameter_trends"] = [t.to_dict() for t in trends]
    if probabilities is not None:
        extra["probabilities"] = probabilities.to_dict()
    if law is not None:
        extra["unknown_law"] = law.to_dict()
    if uneven:
        extra["uneven_forces"] = [u.to_dict() for u in uneven]
    if checks:
        extra["predictive_checks"] = [c.to_dict() for c in checks]
        extra["checks"] = checks_by_output(checks, last.fits(judged_on))
    if by_evidence is not None and by_evidence.announcement.predictive:
        extra["predictive_gain"] = {name: gain.to_dict() for name, gain in by_evidence.announcement.predictive.items()}
    if by_evidence is not None and by_evidence.announcement.unconfirmed:
        extra["not_confirmed_on_held_out_records"] = list(by_evidence.announcement.unconfirmed)
    if omnibus is not None:
        extra["follows_inputs"] = _omnibus_entry(omnibus)
    return Conclusion(
        verdict=verdict,
        sentence=" ".join(sentences),
        stages=stages,
        refused=refused,
        hidden=hidden,
        negligible=negligible,
        next_measurement=(*(t.sentence for t in trips), *by_hand),
        unknown=curve,
        warnings=tuple(warnings),
        residual_mode=state.mode,
        residual_reason=state.mode_reason,
        seed=problem.seed,
        level=problem.level,
        name=problem.name,
        paths=tuple(paths),
        extra=extra,
        probabilities=probabilities,
        models=tuple(by_evidence.tried.models.values()) if by_evidence is not None else (),
    )


def _force_that_follows_inputs(state: SearchState) -> tuple[UnknownCurve, UnknownForce] | None:
    """Return the force that would explain the residual where that follows the inputs, and its description."""
    problem = state.problem
    state.omnibus = omnibus_of_stage(state.stages[-1], level=problem.level / LEVEL_SHARES, seed=problem.seed)
    return find_unidentified_force(state)


def _slow_force(forces: RandomForces | None, stage: Stage) -> str:
    """Return a sentence on random forces slower than the records that a large error is put down to, if it is."""
    large = outputs_far_above_noise(stage)
    return slow_force_sentence(forces, large[0]) if forces is not None and forces.slower_than_records and large else ""


def _checks(state: SearchState, by_evidence: EvidenceSearch | None) -> tuple[Check, ...]:
    """Return the predictive checks of the final model of a search by evidence."""
    likelihood = by_evidence.likelihood if by_evidence is not None else None
    if likelihood is None:
        return ()
    checks = state.if_simulated("whether the innovations are as promised", lambda: predictive_checks(likelihood))
    return checks or ()


def _uneven(state: SearchState, by_evidence: EvidenceSearch | None) -> tuple[UnevenForce, ...]:
    """Return the random forces of the final model that act only in a part of the motion."""
    likelihood = by_evidence.likelihood if by_evidence is not None else None
    if likelihood is None:
        return ()
    return state.if_simulated("whether random forces are even", lambda: uneven_random_forces(likelihood)) or ()


def _unknown_law(by_evidence: EvidenceSearch | None) -> UnknownLaw | None:
    """Return what follows the machine's state beside the model that was taken, if that was asked."""
    taken = by_evidence.tried.taken if by_evidence is not None else None
    return taken.unknown_law if taken is not None else None


def _unconfirmed(state: SearchState, by_evidence: EvidenceSearch | None) -> Unconfirmed | None:
    """Return the effects that are most probable, and that the records held out do not confirm; None without any.

    A search by significance has some where an output of these is predicted better and another worse: something is
    missing, and it is not what was tried.
    """
    if by_evidence is None:
        if not state.taken_back:
            return None
        names = [title_of_name(each.name) for each in reversed(state.taken_back)]
        worse = list(dict.fromkeys(output for each in state.taken_back for output in each.worse))
        is_predicted = "is predicted" if len(worse) == 1 else "are predicted"
        it = "it" if len(names) == 1 else "them"
        why = f"{listed(worse)} {is_predicted} worse with {it} on the records held out"
        return Unconfirmed(listed(names), why)
    if not by_evidence.announcement.unconfirmed:
        return None
    probabilities = _probabilities(by_evidence, "")
    assert probabilities is not None
    if probabilities.models.get((), 0.0) > 0.5:
        return None
    most = max((m for m in by_evidence.tried.models.values() if m.unconfirmed), key=lambda m: m.total)
    names = [title_of_name(name) for name in most.key]
    return Unconfirmed(listed(names), "the records held out are not predicted better with that")


def _probabilities(by_evidence: EvidenceSearch | None, verdict: str) -> Posterior | None:
    """Return how probable each answer is, for a search by evidence."""
    if by_evidence is None:
        return None
    names = key_of(by_evidence.state.stages[-1].effects)
    start = by_evidence.tried.start
    asked = start.proposals if start is not None else None
    taken = by_evidence.tried.taken
    final = taken.proposals if taken is not None else None
    unknown = verdict == "unknown effect"
    tried = by_evidence.tried
    return posterior(tried.models, names, asked, final, tried.prior, unknown=unknown, wander=tried.wander)


def _accepted_curve(
    state: SearchState, accepted: Sequence[AcceptedEffect], stages: Sequence[Stage]
) -> tuple[UnknownCurve | None, UnknownForce | None]:
    """Return the last free curve that was accepted, and its description; None and None if there is none."""
    last = next((a for a in reversed(accepted) if a.effect.definition.free_form), None)
    if last is None:
        return None, None
    effect = next(e for e in stages[-1].effects if e.component_name == last.effect.component_name)
    force = state.if_simulated("what the unknown force depends on", lambda: describe_accepted_curve(state))
    statement = " ".join([curve_statement(last), *([force.sentence] if force is not None else [])])
    curve = UnknownCurve.of_effect(
        effect, stages[-1].identify, statement, p_value=last.p_value, delta_bic=last.delta_bic
    )
    return curve, force


def _nearest_laws(state: SearchState, by_evidence: EvidenceSearch | None) -> list[str]:
    """Return a sentence for every free curve of the answer on the laws that come nearest to it."""
    if by_evidence is None or not any(e.definition.free_form for e in state.stages[-1].effects):
        return []
    found = state.if_simulated("which laws come nearest to the curve", by_evidence.laws_of_curves) or []
    return [laws_of_curve_sentence(curve, laws) for curve, laws in found if laws]


def _prior_conflict_warnings(state: SearchState, accepted: Sequence[AcceptedEffect]) -> list[str]:
    if accepted:
        conflict = state.prior_conflict
        return [conflict.message(title_of(accepted[0]))] if conflict is not None else []
    conflicts = [conflict_text(q, value) for q, value in prior_conflicts(state.stages[-1].identify)]
    if not conflicts:
        return []
    return [f"Calibration ends outside the stated uncertainty: {' and '.join(conflicts)}. Check the stated values."]


def _inputs_with_feedback(state: SearchState) -> dict[str, str]:
    """Return the recorded inputs that react to the residual, if a search was made."""
    if state.mode == "inverse" or not state.decisions:  # where motion is given, it is an input
        return {}
    stage = state.stages[-1]
    return inputs_with_feedback(stage.linearised_problem())


def _trends(state: SearchState) -> tuple[Trend, ...]:
    """Return the parameters that change along the records, if a search was made."""
    if not state.decisions:
        return ()
    return parameter_trends(state.stages[-1], state.problem.level, state.problem.seed)


def _omnibus_entry(omnibus: Omnibus) -> dict[str, Any]:
    return {"p": omnibus.p, "rejects": omnibus.rejects, "most": omnibus.leading}


def _not_found(state: SearchState) -> tuple[tuple[RefusedEffect, ...], tuple[HiddenEffect, ...]]:
    """Return the effects that the last scan could not answer for, and those that it did not find."""
    if not state.decisions:
        return (), ()
    decision = state.decisions[-1]
    present = {(e.kind, e.where) for e in state.stages[-1].effects}
    refused = [RefusedEffect(e.kind.name, e.where, why) for e, why in decision.refused]
    for name, why in decision.scan.refused.items():
        kind, _, where = name.partition("@")
        if (kind, where) not in present:
            refused.append(RefusedEffect(kind, where, why))
    not_found = (Verdict.ABSENT, Verdict.CANNOT_TELL)
    hidden = [
        HiddenEffect(
            r.kind,
            r.where,
            float(r.smallest_visible_strength),
            float(r.strength_that_matters),
            unit_at(state.stage.system, r.kind, r.where),
        )
        for r in decision.scan.rows
        if r.verdict in not_found and (r.kind, r.where) not in present
    ]
    return tuple(refused), tuple(hidden)


def _negligible(state: SearchState) -> tuple[NegligibleEffect, ...]:
    """Return the effects that the last step found to be present, but to change too little."""
    if not state.decisions:
        return ()
    decision = state.decisions[-1]
    present = {(e.kind, e.where) for e in state.stages[-1].effects}
    rows = {r.name: r for r in decision.scan.rows if r.verdict is Verdict.NEGLIGIBLE}
    rows |= {r.name: r for r in decision.irrelevant}
    negligible = []
    for r in sorted(rows.values(), key=lambda r: r.delta_bic)[:MOST_NEGLIGIBLE]:
        if (r.kind, r.where) not in present and r.delta_bic < 0.0:
            most = int(np.argmax(np.abs(r.expected_strength)))
            size, std = float(r.expected_strength[most]), float(r.standard_error[most])
            unit = unit_at(state.stage.system, r.kind, r.where)
            negligible.append(NegligibleEffect(r.kind, r.where, size, std, float(r.p_value), unit))
    return tuple(negligible)
