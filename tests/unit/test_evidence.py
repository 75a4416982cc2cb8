"""Evidence: priors are proper, probabilities add up, gains are relative to the blocks."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from discrepancy.conclusion.sentences import Unconfirmed, answer, probability_sentence
from discrepancy.effects.effect import Effect
from discrepancy.evidence.criterion import Evidence, ModelPrior, log_prior_of_strengths
from discrepancy.evidence.moves import TriedModel, key_of
from discrepancy.evidence.policy import POLICY
from discrepancy.evidence.posterior import posterior, rivals_of
from discrepancy.stages.held_out_errors import gain_of_errors
from discrepancy.statistics.verdicts import Verdict

GAIN = Effect(kind="sensor_gain", where="speed", strengths={"gain": 0.1})
OFFSET = Effect(kind="sensor_offset", where="speed", strengths={"offset": 0.1})


def tried(total: float, *names: str, parent: tuple[str, ...] | None = None, matters: bool = True) -> TriedModel:
    return TriedModel(
        likelihood=None,
        key=tuple(sorted(names)),
        evidence=Evidence(log_likelihood=total, log_prior=0.0, log_odds=0.0),
        parent=parent,
        matters=matters,
    )


def by_key(*models: TriedModel) -> dict[tuple[str, ...], TriedModel]:
    return {m.key: m for m in models}


def test_the_prior_of_models_adds_up_to_one() -> None:
    prior = ModelPrior(candidates=3, shapes={}, stated={})
    total = math.exp(prior.log_probability([]))
    total += 3 * math.exp(prior.log_probability([GAIN])) + 3 * math.exp(prior.log_probability([GAIN, OFFSET]))
    assert total == pytest.approx(0.5 + 0.25 + 0.125)
    assert math.exp(prior.log_probability([])) == 0.5


def test_the_shapes_of_a_law_share_its_prior() -> None:
    plain = ModelPrior(candidates=3, shapes={}, stated={})
    shaped = ModelPrior(candidates=3, shapes={str(GAIN): 8}, stated={})
    assert shaped.log_probability([GAIN]) == pytest.approx(plain.log_probability([GAIN]) - math.log(8.0))


@pytest.mark.parametrize("one_sided", [True, False])
def test_the_prior_of_a_strength_is_proper(one_sided: bool) -> None:
    values = np.tan(np.linspace(0.0 if one_sided else -np.pi / 2, np.pi / 2, 200_001)[1:-1])
    density = [math.exp(log_prior_of_strengths(np.array([v]), np.array([2.0]), one_sided)) for v in values[::20]]
    assert np.trapezoid(density, values[::20]) == pytest.approx(1.0, abs=0.01)


def test_the_key_of_a_model_does_not_depend_on_order() -> None:
    assert key_of([GAIN, OFFSET]) == key_of([OFFSET, GAIN])


def test_probabilities_add_up_and_rivals_share_them() -> None:
    models = by_key(tried(0.0), tried(12.0, "a@x"), tried(10.0, "b@x"), tried(-50.0, "a@x", "c@y", parent=("a@x",)))
    result = posterior(models, ["a@x"], None, temperature=1.0)
    assert sum(result.models.values()) == pytest.approx(1.0)
    (effect,) = result.effects
    assert effect.probability == pytest.approx(1.0 / (1.0 + math.exp(-2.0)), rel=1e-3)
    assert effect.alternatives == (("b@x", pytest.approx(1.0 - effect.probability, rel=1e-3)),)
    assert posterior(models, ["a@x"], None, temperature=10.0).effects[0].probability < effect.probability


def test_an_effect_that_does_not_matter_counts_for_the_model_without_it() -> None:
    models = by_key(tried(0.0), tried(40.0, "a@x", parent=(), matters=False))
    assert posterior(models, [], None).models == pytest.approx({(): 1.0})


def test_what_no_search_would_have_seen_is_a_part_of_what_nothing_was_found_of() -> None:
    """One effect outside the catalogue, half as probable as none before, of which the search misses a share."""
    result = posterior(by_key(tried(0.0)), [], None)
    assert result.unknown / result.nothing == pytest.approx(0.5 * POLICY.unseen)
    assert result.unknown + result.nothing == pytest.approx(1.0)
    named = posterior(by_key(tried(0.0), tried(90.0, "a@x", parent=())), ["a@x"], None)
    assert named.unknown == 0.0


def test_a_model_that_fails_its_checks_leaves_nothing_to_nothing() -> None:
    models = by_key(tried(0.0), tried(-40.0, "a@x", parent=()))
    result = posterior(models, [], None, unknown=True)
    assert result.nothing == 0.0
    assert result.unknown == pytest.approx(1.0, abs=1e-4)


def test_a_gain_is_relative_to_each_block() -> None:
    """One block with a thousand times the error does not decide alone."""
    other = np.array([[1.0], [1.0], [1.0], [1000.0]])
    one = 0.5 * other
    gain = gain_of_errors(("y",), one, other)
    assert gain.share[0] == pytest.approx(0.5)
    assert gain.standard_error[0] == pytest.approx(0.0, abs=1e-12)
    assert gain.helps(0.02, 2.0)
    worse = gain_of_errors(("y",), other, one)
    assert worse.share[0] == pytest.approx(-1.0)
    assert worse.harms(0.02, 2.0)
    assert not worse.helps(0.02, 2.0)


def test_what_few_records_show_goes_by_students_t() -> None:
    """Two records with errors 1.7 and 3.9 % larger: 2.5 of their own standard errors, which chance often shows."""
    two = gain_of_errors(("y",), np.array([[1.017], [1.039]]), np.ones((2, 1)))
    assert two.harms(0.02, 2.0)
    assert not two.harms(0.02, two.in_normal_errors(2.0))
    many = gain_of_errors(("y",), np.tile([[1.017], [1.039]], (10, 1)), np.ones((20, 1)))
    assert many.harms(0.02, many.in_normal_errors(2.0))
    one = gain_of_errors(("y",), np.array([[2.0]]), np.ones((1, 1)))
    assert not one.harms(0.02, one.in_normal_errors(2.0))


def test_what_could_not_be_named_is_said_where_it_is_probable() -> None:
    names = ("constant_force@bearing",)
    likely = posterior(by_key(tried(0.0), tried(2.0 * POLICY.temperature, *names)), [], None)
    text = probability_sentence(likely)
    assert likely.models[()] == pytest.approx(1.0 / (1.0 + math.exp(2.0)))
    assert "well enough to be named: 88 %, most probably a constant force at bearing (88 %)" in text
    assert "named" not in probability_sentence(posterior(by_key(tried(0.0), tried(-9.0, *names)), [], None))


def test_what_the_records_cannot_tell_is_as_probable_as_before() -> None:
    """Of three effects that were not fitted the records exclude one, bound one, and say nothing of the last."""
    prior = ModelPrior(candidates=3, shapes={}, stated={})
    rows = [SimpleNamespace(name="b@x", verdict=Verdict.NEGLIGIBLE)]
    scored = [SimpleNamespace(name=n, gain=g) for n, g in (("a@x", -60.0), ("b@x", 0.0), ("c@x", 0.0))]
    final = SimpleNamespace(candidates=scored, scan=SimpleNamespace(rows=rows), alike={})
    result = posterior(by_key(tried(0.0)), [], None, final, prior)  # type: ignore[arg-type]
    one = math.exp(prior.log_probability_of_names(1) - prior.log_probability_of_names(0))
    assert result.models["c@x",] == pytest.approx(one / (1.0 + one), rel=1e-6)
    assert result.models["a@x",] < 1e-8
    assert ("b@x",) not in result.models
    assert result.models[()] == pytest.approx(1.0 / (1.0 + one), rel=1e-6)


def test_a_model_that_lost_an_effect_counts_for_what_is_left_of_it() -> None:
    """The second effect was not confirmed: the first, which stays, is as probable as both were together."""
    both, first = tried(100.0, "a@x", "b@x", parent=("b@x",)), tried(60.0, "a@x", parent=("a@x", "b@x"))
    both.refuse("b@x is not announced", first)
    result = posterior(by_key(tried(0.0), tried(50.0, "b@x", parent=()), both, first), ["a@x"], None)
    assert result.effects[0].probability > 0.99


@pytest.mark.parametrize(("behind", "keeps"), [(0.4, True), (2.0 * POLICY.improvement, False)])
def test_a_law_that_is_as_good_as_the_simpler_one_in_its_place_keeps_its_probability(behind, keeps):
    """Evidence that is equal does not become certainty because the simpler law is the one to name."""
    complex_law, simple = tried(60.0, "hysteresis@x", parent=()), tried(60.0 - behind, "rub@x", parent=())
    complex_law.refuse("records left out are predicted no better with it", simple)
    models = by_key(tried(0.0), complex_law, simple)
    (effect,) = posterior(models, ["rub@x"], None).effects
    share = 1.0 / (1.0 + math.exp(behind / POLICY.temperature)) if keeps else 1.0
    assert effect.probability == pytest.approx(share, abs=1e-6)
    assert [name for name, _ in effect.alternatives] == ["hysteresis@x"] * keeps
    assert [r.kind for r in rivals_of(simple, "rub@x", models, None)] == ["hysteresis"] * keeps


def test_models_that_count_for_each_other_end() -> None:
    one, other = tried(10.0, "a@x", parent=("b@x",)), tried(9.0, "b@x", parent=("a@x",))
    one.refuse("", other)
    other.refuse("", one)
    assert sum(posterior(by_key(tried(0.0), one, other), [], None).models.values()) == pytest.approx(1.0)


def test_an_effect_that_the_records_held_out_do_not_confirm_keeps_its_probability() -> None:
    """The others ask for it with sixty nats, so that nothing is missing is not probable."""
    nothing, one = tried(0.0), tried(60.0, "a@x", parent=())
    one.refuse("a@x is not announced", nothing)
    assert posterior(by_key(nothing, one), [], None).models[()] > 0.99
    one.unconfirmed = True
    result = posterior(by_key(nothing, one), [], None)
    assert result.nothing < 1e-6
    assert result.models["a@x",] > 0.99


def test_what_is_not_confirmed_is_said_and_not_named() -> None:
    unconfirmed = Unconfirmed("end stop at posts", "the records held out are not predicted better with that")
    text = answer((), (), (), "validate", "unknown effect", unconfirmed)
    assert text.startswith("Something is missing. It looks most like end stop at posts, but the records held out are ")
    assert "no effect of the catalogue" not in text
