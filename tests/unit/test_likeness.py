"""Likeness: a candidate that a parameter stands for, and one that is an effect of the model under another name."""

from __future__ import annotations

import numpy as np
import pytest

from discrepancy.evidence.likeness import parameter_likeness
from discrepancy.statistics.blocks import Sensitivities

N = 200
T = np.linspace(0.0, 1.0, N)
MASS, FRICTION = np.sin(9.0 * T), np.sign(np.cos(5.0 * T))


def likeness(std=(np.inf, np.inf), own=None):
    columns = np.stack([MASS, FRICTION], axis=1)[:, None, :]
    return parameter_likeness(
        Sensitivities(names=["mass", "friction"], blocks=[columns], prior_std=std, nuisance=[own])
    )


def test_a_candidate_that_does_what_a_parameter_does_is_its() -> None:
    assert likeness().owner([2.0 * MASS[:, None]]) == "mass"
    assert likeness().owner([-0.1 * FRICTION[:, None]]) == "friction"


def test_a_candidate_of_its_own_belongs_to_no_parameter() -> None:
    assert likeness().owner([(MASS + FRICTION)[:, None]]) == ""
    assert likeness().owner([np.zeros((N, 1))]) == ""


def test_without_parameters_a_candidate_is_its_own() -> None:
    none = parameter_likeness(
        Sensitivities(names=[], blocks=[np.zeros((N, 1, 0))], prior_std=(), nuisance=[np.ones((N, 1, 1))])
    )
    assert none.owner([MASS[:, None]]) == ""


def test_a_parameter_that_would_have_to_move_further_than_its_prior_allows_does_not_stand_for_a_candidate() -> None:
    assert likeness(std=(1.0, np.inf)).owner([2.9 * MASS[:, None]]) == "mass"
    assert likeness(std=(1.0, np.inf)).owner([3.1 * MASS[:, None]]) == ""


def test_what_a_record_has_of_its_own_tells_nothing_apart() -> None:
    offset = np.ones((N, 1, 1))
    assert likeness(own=offset).owner([(2.0 * MASS + 40.0)[:, None]]) == "mass"
    assert likeness().owner([(2.0 * MASS + 40.0)[:, None]]) == ""


def test_the_correlation_beside_everything_else_is_the_partial_one() -> None:
    alike = likeness().beside(["friction"])
    assert alike([(FRICTION + 3.0 * MASS)[:, None, None]]) == pytest.approx(1.0, abs=1e-9), "but for the mass, the same"
    other = np.sin(60.0 * T)
    friction, left = (v - (v @ MASS) / (MASS @ MASS) * MASS for v in (FRICTION, other))
    direct = abs(friction @ left) / np.linalg.norm(friction) / np.linalg.norm(left)
    assert alike([other[:, None, None]]) == pytest.approx(direct, abs=1e-9)
    assert likeness().beside(["unknown"])([other[:, None, None]]) == 0.0


def test_a_parameter_that_is_well_known_explains_nothing_of_a_candidate() -> None:
    loose, known = (likeness(std=(std, np.inf)).beside(["friction"]) for std in (1e6, 1e-6))
    candidate = [(FRICTION + 3.0 * MASS)[:, None, None]]
    both = FRICTION @ (FRICTION + 3.0 * MASS)
    direct = abs(both) / np.linalg.norm(FRICTION) / np.linalg.norm(FRICTION + 3.0 * MASS)
    assert loose(candidate) == pytest.approx(1.0, abs=1e-9)
    assert known(candidate) == pytest.approx(direct, abs=1e-9)
