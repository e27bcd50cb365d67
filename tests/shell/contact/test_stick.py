"""Slips kept between steps: found again by what touches, never longer than full friction, across the new normals."""

from __future__ import annotations

import numpy as np

from yarnscale.shell.contact.stick import begun_with, ended_with
from yarnscale.shell.state import Slips

UP = np.array([0.0, 0.0, 1.0])


def test_slips_come_back_to_the_contacts_that_they_belong_to() -> None:
    rng = np.random.default_rng(1)
    between = np.unique(rng.integers(0, 40, (300, 5)), axis=0)
    rng.shuffle(between)
    slips = 1e-5 * rng.uniform(-0.5, 0.5, (len(between), 3)) * [1, 1, 0]
    kept = ended_with(between, slips, 1e-5)
    order = rng.permutation(len(between))[:200]
    asked = np.concatenate([between[order], 100 + between[:50]])
    begun = begun_with(kept, asked, np.tile(UP, (len(asked), 1)), 2e-5)
    np.testing.assert_allclose(begun[:200], 2.0 * slips[order], atol=1e-18)
    assert not begun[200:].any(), "new contacts begin without slip"


def test_what_slid_keeps_the_slip_of_full_friction_across_the_normal() -> None:
    between = np.array([[0, 1, 0, 0, 0], [0, 2, 0, 0, 0]])
    kept = ended_with(between, np.array([[3e-3, 4e-3, 0.0], [0.0, 5e-6, 0.0]]), 1e-5)
    np.testing.assert_allclose(kept.amounts, [[0.6, 0.8, 0.0], [0.0, 0.5, 0.0]], atol=1e-15)
    sideways = np.tile([1.0, 0.0, 0.0], (2, 1))
    np.testing.assert_allclose(begun_with(kept, between, sideways, 1.0), [[0, 0.8, 0], [0, 0.5, 0]], atol=1e-15)


def test_without_slips_every_contact_begins_without() -> None:
    between, normals = np.zeros((2, 5), np.int64), np.tile(UP, (2, 1))
    empty = Slips(np.zeros((0, 5), np.int64), np.zeros((0, 3)))
    for slips in (None, empty):
        assert not begun_with(slips, between, normals, 1.0).any()
    assert begun_with(empty, between[:0], normals[:0], 1.0).shape == (0, 3)
