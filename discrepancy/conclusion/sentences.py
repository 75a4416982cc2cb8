"""The sentences of a conclusion: the answer, its warnings, and what to do next."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from discrepancy.conclusion.conclusion import HiddenEffect, NegligibleEffect
from discrepancy.effects.effect import Effect
from discrepancy.effects.gain_words import gain_in_words
from discrepancy.effects.kinds import kind_named
from discrepancy.evidence.checks import Check
from discrepancy.evidence.laws_of_a_curve import CurveLaws
from discrepancy.evidence.posterior import Posterior
from discrepancy.evidence.unknown_law import UNKNOWN
from discrepancy.questions.explained_share import explained_share
from discrepancy.stages.prior_conflict import conflict_text, prior_conflicts
from discrepancy.stages.stage import AcceptedEffect, RivalExplanation, Stage
from discrepancy.statistics.thresholds import SHOWN_GROWTH
from multibody.base.quantity_text import quantity_text, two_quantities_text

__all__ = [
    "Unconfirmed",
    "answer",
    "check_sentence",
    "curve_statement",
    "laws_of_curve_sentence",
    "listed",
    "manual_checks",
    "outputs_far_above_noise",
    "percent_words",
    "poor_fit_note",
    "probability_sentence",
    "stopped_early_warnings",
    "time_limit_sentence",
    "time_limit_warnings",
    "title_of",
    "title_of_name",
    "title_of_rival",
    "warnings_about_effects",
]

#: Multiple of its noise from which nobody would take an output's error for noise: chosen.
LARGE_OVER_NOISE = 10.0
#: Multiple of its noise, and share of its spread, from which a model does not follow an output: noise then makes a
#: ninth of the mean square error, and the error can be seen beside what the output does.
MORE_THAN_NOISE, LARGE_OVER_SPREAD = 3.0, 0.1
#: Probability of effects that were not named from which it is said.
LEAST_UNNAMED = 0.1
#: Relative change of an error below which it is said to stay.
SAME_ERROR = 0.01
#: Things to do next that are listed.
MOST_CHECKS = 6

_NUMBER = {1: "one effect", 2: "two effects", 3: "three effects"}


@dataclass(frozen=True)
class Unconfirmed:
    """Effects for which the records speak, and that are not announced: their names in words, and why not."""

    names: str
    why: str


def kind_title(kind: str) -> str:
    """Return a kind in words."""
    return kind_named(kind.split(" ")[0]).text.title


def title_of_name(name: str) -> str:
    """Return the words for ``kind@where``."""
    kind, _, where = name.partition("@")
    return f"{kind_title(kind)} at {where}"


def title_of(accepted: AcceptedEffect) -> str:
    """Return an accepted effect in words, with its place."""
    return f"{kind_title(accepted.effect.kind)} at {accepted.effect.where}"


def title_of_rival(rival: RivalExplanation) -> str:
    """Return another explanation in words, with its place or its two places.

    Examples
    --------
    >>> from dataclasses import replace
    >>> late = RivalExplanation(
    ...     kind="sensor_delay", where="speed", delta_bic=1.0, refitted=True, indistinguishable=True
    ... )
    >>> title_of_rival(late)
    'a sensor delay at speed'
    >>> title_of_rival(replace(late, kind="sensor_delay with input_delay@torque"))
    'a sensor delay at speed with an input delay at torque'
    """
    parts = []
    for name in rival.names:
        kind, _, where = name.partition("@")
        kind, _, over = kind.partition(" ")
        parts.append(f"{kind_named(kind).text.title}{f' ({over})' if over else ''} at {where}")
    return " with ".join(parts)


# -------------------------------------------------------------------- the answer


def answer(
    stages: Sequence[Stage],
    hidden: Sequence[HiddenEffect],
    negligible: Sequence[NegligibleEffect],
    judged_on: str,
    verdict: str = "",
    unconfirmed: Unconfirmed | None = None,
) -> str:
    """Return the answer in two or three sentences.

    Parameters
    ----------
    stages : sequence of Stage
        As given, recalibrated, then one for each effect.
    hidden : sequence of HiddenEffect
        Effects that were searched for and not found.
    negligible : sequence of NegligibleEffect
        Effects that are present but change too little.
    judged_on : {"identify", "validate"}
        Records on which the explained share is computed.
    verdict : str
        Of the conclusion.
    unconfirmed : Unconfirmed, optional
        The effects that the verdict "unknown effect" rests on, where the records held out did not confirm them.
    """
    accepted = [s.accepted for s in stages if s.accepted is not None]
    if not accepted and verdict == "unknown effect" and unconfirmed is not None:
        return (
            f"Something is missing. It looks most like {unconfirmed.names}, but {unconfirmed.why}, so it counts as "
            "unknown." + negligible_sentence(negligible)
        )
    if not accepted and verdict == "unknown effect":
        return "Something is missing that no effect of the catalogue explains." + negligible_sentence(negligible)
    if not accepted:
        given = stages[-1].effects
        added = listed([f"{kind_title(e.kind)} at {e.where}" for e in given])
        fall = _error_reduction(stages[1], stages[-1]) if given else ""
        return _nothing_found(hidden, negligible, added, fall)
    names = [title_of(a) for a in accepted]
    count = _NUMBER.get(len(names), f"{len(names)} effects")
    text = f"The model lacks {count}: {listed(names)}."
    text += "".join(_wrong_factor(a, stages[-1]) for a in accepted)
    text += _error_reduction(stages[1], stages[-1]) + _conflict_without_effects(stages[1], stages[-1])
    for first, second in pairwise(zip(accepted, names, strict=True)):
        if first[0].masked_by == str(second[0].effect):
            text += f" {first[1].capitalize()} and {second[1]} mask each other: either alone changes little."
    share, _ = explained_share(stages[1], stages[-1], judged_on)
    if share > 0.0:
        text += f" {100 * share:.0f} % of the mean square error above the noise floor is gone."
    return text + _tie(accepted, names)


def listed(names: Sequence[str]) -> str:
    """Return names in a row, each once, with how often it occurs.

    Examples
    --------
    >>> listed(["a force that repeats along the way at z", "drag at z", "a force that repeats along the way at z"])
    'a force that repeats along the way at z (2 times); drag at z'
    """
    counts = Counter(names)
    return "; ".join(name if n == 1 else f"{name} ({n} times)" for name, n in counts.items())


def _wrong_factor(accepted: AcceptedEffect, stage: Stage) -> str:
    """Return a sentence, with a space before it, on a gain that is a sign or a power of ten; else an empty text."""
    effect = next((e for e in stage.effects if e.component_name == accepted.effect.component_name), accepted.effect)
    name = effect.parameter_name("gain")
    if "gain" not in effect.strengths or name not in stage.identify.to_dict():
        return ""
    words = gain_in_words(effect.strengths["gain"], *stage.identify.interval(name))
    verb = "measured" if effect.definition.at == "sensor" else "recorded"
    return f" It looks as if {effect.where} were {verb} {words}." if words else ""


def _nothing_found(
    hidden: Sequence[HiddenEffect], negligible: Sequence[NegligibleEffect], added: str = "", fall: str = ""
) -> str:
    """Return that nothing is missing; beyond effects that were added by hand, with the fall of the error, if any."""
    small = negligible_sentence(negligible)
    could = [f"{kind_title(kind)} at {where}" for kind, where, mde, delta, _ in hidden if not (mde < delta < math.inf)]
    base = f"Added by hand: {added}.{fall} No further missing effect" if added else "No missing effect"
    base += " was found" + (" that would matter" if small else "")
    if not could:
        return f"{base}; every effect of the catalogue that would matter would have been detected.{small}"
    many = f"{len(could)} effects of a size that would matter, for example {could[0]}"
    return f"{base}.{small} These records could still hide {many}."


def negligible_sentence(negligible: Sequence[NegligibleEffect]) -> str:
    """Return a sentence, with a space before it, about the first effect that is present but changes too little."""
    if not negligible:
        return ""
    kind, where, size, std, p, unit = negligible[0]
    strength = f"{quantity_text(size, unit)} ± {quantity_text(std, unit, 2)}, p = {p:.1g}"
    return (
        f" {kind_title(kind).capitalize()} at {where} is present ({strength}), but its influence on the calibrated "
        "model is below the noise floor of every output."
    )


def _error_reduction(before: Stage, after: Stage) -> str:
    """Return how the error of every output has changed."""
    part = "validate" if after.validate is not None else "identify"
    a, b = before.rmse(part), after.rmse(part)
    records = "on records that were not used to find it" if part == "validate" else "on the records used to find it"
    them = "it" if len(after.effects) == 1 else "them"
    changes = []
    for name in sorted(b, key=lambda n: b[n] / a[n] if a[n] > 0.0 else 1.0):
        unit = after.system.unit(name)
        before_text, after_text = two_quantities_text(a[name], b[name], unit)
        if a[name] > 0.0 and abs(b[name] / a[name] - 1.0) < SAME_ERROR:
            changes.append(f"that of {name} stays at {after_text}")
        else:
            verb = "falls" if b[name] < a[name] else "rises"
            shows = part == "validate" and b[name] ** 2 > (1.0 + SHOWN_GROWTH) * a[name] ** 2
            chance = " (which may be chance)" if shows else ""  # else it would not have been announced
            changes.append(f"that of {name} {verb} from {before_text} to {after_text}{chance}")
    first, *others = changes
    listed = first.replace("that of", "the error of", 1) + "".join(f", {c}" for c in others)
    return f" With {them} {listed}, {records}."


def _conflict_without_effects(before: Stage, after: Stage) -> str:
    """Return which parameters calibration takes out of their stated uncertainty where the effects are left out."""
    within = {q.name for q in after.identify.parameters} - {q.name for q, _ in prior_conflicts(after.identify)}
    conflicts = [conflict_text(q, value) for q, value in prior_conflicts(before.identify) if q.name in within]
    without = "it" if len(after.effects) == 1 else "them"
    return f" Without {without} the fit needs {' and '.join(conflicts)}." if conflicts else ""


def _tie(accepted: Sequence[AcceptedEffect], names: Sequence[str]) -> str:
    """Return what else the last effect could be, or two effects of the answer together."""
    for k in reversed(range(len(accepted))):
        a = accepted[k]
        pair = bool(a.masked_by) and k > 0 and a.masked_by == str(accepted[k - 1].effect)
        for other in a.rivals:
            two = len(other.names) > 1
            if other.indistinguishable and other.kind != a.effect.kind and (two or a in _last(accepted)):
                both = names[k - 1 : k + 1] if pair else names[k : k + 2]
                these = " with ".join(both) if two else names[k]
                return f" These records cannot distinguish {these} from {title_of_rival(other)}."
    return ""


def _last(accepted: Sequence[AcceptedEffect]) -> Sequence[AcceptedEffect]:
    """Return the last effect, or the last two where they mask each other."""
    return accepted[-2:] if accepted[-1].masked_by else accepted[-1:]


def check_sentence(failed: Sequence[Check]) -> str:
    """Return where the final model does not predict its records as it promises."""
    worst = max(failed, key=lambda c: abs(c.deviations))
    if worst.what == "whiteness":
        how = f"successive innovations of {worst.output} are correlated ({worst.value:.2f})"
    elif worst.what == "size":
        how = f"the innovations of {worst.output} are {worst.value:.2g} times as large as they should be"
    else:
        how = (
            f"the innovations of {worst.output} at {worst.what} have {worst.value:.2g} times the mean "
            "square of the others"
        )
    return f"The model does not predict its records as well as it promises: {how}."


def probability_sentence(probabilities: Posterior) -> str:
    """Return how probable the answer is, and what else it could be."""
    if not probabilities.effects:
        return (
            f"Probability that nothing is missing which would matter: {percent_words(probabilities.nothing)}; that "
            f"something outside the catalogue is: {percent_words(probabilities.unknown)}{_unnamed(probabilities)}."
        )
    parts = []
    for effect in probabilities.effects:
        name = f"{kind_title(effect.kind)} at {effect.where}"
        others = [f"{title_of_name(n)} ({percent_words(p)})" for n, p in effect.alternatives]
        parts.append(f"{name} {percent_words(effect.probability)}" + (f", or {', or '.join(others)}" if others else ""))
    return f"Probabilities: {'; '.join(parts)}."


def _unnamed(probabilities: Posterior) -> str:
    """Return how probable effects are that were not named, and the first of them; an empty text where hardly."""
    unnamed = {k: p for k, p in probabilities.models.items() if k and not any(n.startswith(UNKNOWN) for n in k)}
    whole = sum(unnamed.values())
    if whole < LEAST_UNNAMED:
        return ""
    names, most = max(unnamed.items(), key=lambda t: t[1])
    first = " with ".join(map(title_of_name, names))
    return (
        f"; that an effect is which these records do not show well enough to be named: {percent_words(whole)}, most "
        f"probably {first} ({percent_words(most)})"
    )


def percent_words(probability: float) -> str:
    """Return a probability in percent."""
    if probability > 0.99:
        return "over 99 %"
    return "under 1 %" if probability < 0.01 else f"{100 * probability:.0f} %"


def verdict_of(accepted: Sequence[AcceptedEffect]) -> str:
    """Return ``"nothing missing"``, ``"effect found"``, ``"ambiguous"`` or ``"unknown effect"``.

    Predictive checks that fail, or an output that is not followed, make ``"partly explained"`` of a model with effects
    (`discrepancy.conclusion.conclude`).
    """
    if not accepted:
        return "nothing missing"
    if any(a.effect.definition.free_form for a in accepted):
        return "unknown effect"
    pairs = any(r.indistinguishable and len(r.names) > 1 for a in accepted for r in a.rivals)
    return "ambiguous" if pairs or any(a.ambiguous for a in _last(accepted)) else "effect found"


def curve_statement(accepted: AcceptedEffect) -> str:
    """Return what a free curve that was accepted says."""
    level = "a dry friction whose level depends on the position"
    over = level if accepted.effect.over == "friction" else f"a function of {accepted.effect.over}"
    ties = [r for r in accepted.rivals if r.indistinguishable]
    alias = f" These records do not distinguish it from {ties[0].kind}." if ties else ""
    where = accepted.effect.where
    return f"The missing force at {where} is best described as {over}; no law of the catalogue fits as well.{alias}"


def laws_of_curve_sentence(curve: Effect, laws: Sequence[CurveLaws]) -> str:
    """Return which law, and which two, come nearest to a free curve, and how near.

    Parameters
    ----------
    curve : Effect
    laws : sequence of CurveLaws
        Not empty.
    """
    of = "position, as a friction" if curve.over == "friction" else curve.over
    text = ""
    for count in (1, 2):
        nearest = next((each for each in laws if len(each.effects) == count), None)
        if nearest is None:
            continue
        names = " together with ".join(_law_words(e) for e in nearest.effects)
        share = f"{percent_words(nearest.share)} of its mean square"
        if not text:
            text = f"The force at {curve.where} over {of} is nearest to {names}, which accounts for {share}"
        else:
            text += f"; of two laws, to {names} ({percent_words(nearest.share)})"
    return f"{text}."


def _law_words(effect: Effect) -> str:
    """Return a law in words, with the difference between its two directions where it has one."""
    if not effect.definition.by_direction:
        return kind_title(effect.kind)
    (_, forward), (name, backward) = effect.strengths.items()
    more = quantity_text(abs(forward - backward), effect.unit(name), 2)
    return f"{kind_title(effect.kind)} ({more} more {'forwards' if forward > backward else 'backwards'})"


def outputs_far_above_noise(stage: Stage) -> list[str]:
    """Return the outputs whose error is a multiple of their noise that nobody would take for noise, largest first."""
    ratios = _errors_over_noise(stage)
    return sorted((n for n, r in ratios.items() if r > LARGE_OVER_NOISE), key=lambda n: -ratios[n])


def _errors_over_noise(stage: Stage) -> dict[str, float]:
    return {n: e / max(stage.noise.get(n, 0.0), 1e-300) for n, e in stage.rmse("identify").items()}


def poor_fit_note(stage: Stage, verdict: str) -> str:
    """Return a sentence, with a space before it, that a model does not follow its records, if it does not."""
    error, shares, over_noise = stage.rmse("identify"), {}, _errors_over_noise(stage)
    for c, name in enumerate(stage.outputs):
        spread = float(np.std(np.concatenate([f.experiment.measured[:, c] for f in stage.identify.fits])))
        if 0.0 < LARGE_OVER_SPREAD * spread < error[name] and over_noise[name] > MORE_THAN_NOISE:
            shares[name] = error[name] / spread
    if not shares:
        return ""
    name = max(shares, key=lambda n: shares[n])
    text = (
        f" The model does not follow these records: the error of {name} is {100.0 * shares[name]:.0f} % of its spread."
    )
    # an answer that says so already needs no second sentence
    return text if verdict == "unknown effect" else f"{text} Something is missing or wrong that was not found."


# -------------------------------------------------------------------- warnings, next steps


def warnings_about_effects(stages: Sequence[Stage]) -> list[str]:
    """Return a warning for every effect that lowers the error of no output on the records held out."""
    warnings = []
    for before, after in pairwise(stages):
        if after.accepted is None or after.validate is None or after.half_of_masking_pair:
            continue
        a, b = before.rmse("validate"), after.rmse("validate")
        if all(b[n] >= a[n] for n in b):
            warnings.append(
                f"{title_of(after.accepted).capitalize()} lowers the error on the records used to find it, but of no "
                "output on those held out: do not trust it."
            )
    return warnings


def stopped_early_warnings(stage: Stage) -> list[str]:
    """Return a warning if the calibration of a stage was stopped before its end."""
    if not stage.identify.stopped_early:
        return []
    return [
        "Calibration was stopped at its limit of simulations before it had come to its end: the parameters, and what "
        "is said of effects beside them, may be wrong. Fix parameters that these records do not tell apart, or state "
        "better start values."
    ]


def time_limit_sentence(limit: float) -> str:
    """Return the sentence that says that a search reached its time limit, in s.

    Examples
    --------
    >>> time_limit_sentence(240.0)
    'The search reached its time limit of 240 s of processor time: there may be more to find.'
    """
    return f"The search reached its time limit of {limit:g} s of processor time: there may be more to find."


def time_limit_warnings(not_tried: Sequence[str]) -> list[str]:
    """Return what a search left out because it had reached its time limit, as a warning.

    Examples
    --------
    >>> time_limit_warnings([])
    []
    >>> time_limit_warnings(["free curves"])
    ['Not tried, because the search had reached its time limit ([study] time_limit raises it): free curves.']
    """
    if not not_tried:
        return []
    what = "; ".join(dict.fromkeys(not_tried))
    return [f"Not tried, because the search had reached its time limit ([study] time_limit raises it): {what}."]


def manual_checks(stages: Sequence[Stage], hidden: Sequence[HiddenEffect]) -> tuple[str, ...]:
    """Return what to check by hand: ties, an effect that could hide, and records to hold out."""
    accepted = [s.accepted for s in stages if s.accepted is not None]
    checks = []
    for a in accepted:
        for other in a.rivals:
            if other.indistinguishable and other.kind != a.effect.kind:
                confirm = kind_named(other.kind.split(" ")[0]).text.confirm
                checks.append(
                    f"To tell {title_of(a)} from {title_of_rival(other)}: "
                    f"{kind_named(a.effect.kind).text.confirm} For the other: {confirm}"
                )
            elif other.indistinguishable and other.where != a.effect.where:
                checks.append(
                    f"{title_of(a).capitalize()} and at {other.where} look the same to these sensors: measure the "
                    "force between the two places, or separate them and repeat."
                )
    weak = sorted((h for h in hidden if not h[2] < h[3] < math.inf), key=lambda h: -h[2] / max(h[3], 1e-300))
    if weak and not accepted:
        kind, where, mde, delta, unit = weak[0]
        checks.append(
            f"To rule out {kind_title(kind)} at {where} (detectable above {quantity_text(mde, unit)}, relevant above "
            f"{quantity_text(delta, unit)}): {kind_named(kind).text.confirm}"
        )
    if stages[-1].validate is None:
        checks.append("Hold out a record ([records] validate): without one the improvement cannot be verified.")
    return tuple(dict.fromkeys(checks))[:MOST_CHECKS]
