"""Woven patterns: the draft is what comes out, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.drawing.weave import (
    basket_draft,
    herringbone_draft,
    plain_draft,
    satin_draft,
    twill_draft,
    weave,
)
from yarnscale.errors import InputError
from yarnscale.yarn.clearance import closest_approach

DRAFTS = {
    "plain": plain_draft(),
    "basket": basket_draft(2),
    "twill": twill_draft(2, 2),
    "satin": satin_draft(5, 2),
    "uneven": np.array([[1, 0, 0], [0, 1, 1]]),
}


@pytest.mark.parametrize("name", DRAFTS)
def test_heights_at_the_crossings_are_those_of_the_draft(name: str) -> None:
    draft = DRAFTS[name]
    picks, ends = draft.shape
    pattern = weave(draft, warp_spacing=3.4, weft_spacing=3.0, vertices_per_stitch=4)
    assert pattern.period == pytest.approx([ends * 3.4e-3, picks * 3.0e-3])
    assert pattern.yarn_shift.tolist() == [[1, 0]] * picks + [[0, 1]] * ends

    def height(yarn: int, axis: int, at: float) -> float:
        edges = pattern.edge_vectors()[pattern.yarns[yarn]]
        first = pattern.vertices[pattern.yarns[yarn][:1]]
        line = np.concatenate([first, first + np.cumsum(edges, axis=0)])
        along = line[:, axis]
        at += pattern.period[axis] * (at < along[0] - 1e-12)
        return float(np.interp(at, along, line[:, 2]))

    for i in range(picks):
        for j in range(ends):
            weft = height(i, 0, (j + 0.5) * 3.4e-3)
            warp = height(picks + j, 1, (i + 0.5) * 3.0e-3)
            assert (warp > weft) == bool(draft[i, j])
            assert abs(warp - weft) > 1.5e-3


@pytest.mark.parametrize("name", DRAFTS)
def test_yarns_have_room(name: str) -> None:
    pattern = weave(DRAFTS[name])
    assert closest_approach(pattern).distance > 0.85 * 2e-3
    assert 0.9 < pattern.rest_length.mean() / pattern.radius < 1.2


def test_drafts() -> None:
    assert basket_draft(2).tolist() == [[1, 1, 0, 0], [1, 1, 0, 0], [0, 0, 1, 1], [0, 0, 1, 1]]
    assert twill_draft(2, 2)[1].tolist() == [0, 1, 1, 0]
    satin = satin_draft(5, 2)
    assert satin.sum(axis=0).tolist() == satin.sum(axis=1).tolist() == [4] * 5
    weft_over = np.argwhere(satin == 0)[:, 1]
    assert ((weft_over[1:] - weft_over[:-1]) % 5 == 2).all()


def test_size_scales_with_the_radius() -> None:
    large, small = weave(plain_draft()), weave(plain_draft(), radius=1e-4)
    assert np.allclose(large.vertices, 10 * small.vertices)


@pytest.mark.parametrize(
    ("draft", "options", "message"),
    [
        ([[1, 0], [0]], {}, "draft rows differ in length"),
        ([[1, 2], [0, 1]], {}, "draft is not binary"),
        ([["a", "b"]], {}, "draft is not binary"),
        ([], {}, "draft has the wrong shape"),
        ([[1, 1], [0, 1]], {}, "draft does not hold together: weft pick 1 never changes sides"),
        (
            [[1, 0, 1, 1], [0, 1, 1, 1], [0, 0, 1, 0], [0, 0, 0, 1]],
            {},
            "draft does not hold together: weft pick 3, weft pick 4, warp end 3, warp end 4 lie at the top",
        ),
        (plain_draft(), {"weft_yarns": "a"}, "weft_yarns has the wrong length; expected 2 kinds of yarn"),
        (plain_draft(), {"warp_yarns": ["a", "2"]}, "warp_yarns entry 2 is no kind of yarn"),
        (plain_draft(), {"radius": -1e-3}, "radius must be positive; expected > 0; found -0.001"),
        (plain_draft(), {"warp_spacing": "wide"}, "warp_spacing must be a number"),
        (plain_draft(), {"warp_spacing": 1.5}, "the yarns of weave overlap at this stitch size"),
        (plain_draft(), {"vertices_per_stitch": 1e9}, "vertices_per_stitch is out of range"),
        (
            plain_draft(),
            {"rest_shape": "odd"},
            "rest_shape is unknown; expected straight or current; found odd",
        ),
    ],
)
def test_impossible_weaves_are_named(draft, options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        weave(draft, **options)


def test_satin_move_must_reach_every_end() -> None:
    with pytest.raises(InputError, match="satin move has a common divisor"):
        satin_draft(6, 2)


def test_herringbone_turns_with_a_cut() -> None:
    draft = herringbone_draft(2, 2, 4)
    assert draft.shape == (4, 8)
    assert (draft[:, 3] == 1 - draft[:, 4]).all()
    assert (draft[:, 7] == 1 - draft[:, 0]).all()
    for left, right, step in ((0, 1, 1), (2, 3, 1), (4, 5, -1), (6, 7, -1)):
        assert (draft[:, right] == np.roll(draft[:, left], step)).all()


def test_kinds_of_yarn_are_numbered_by_their_letters() -> None:
    pattern = weave(plain_draft(), weft_yarns="ba", warp_yarns="cc")
    assert pattern.yarn_material is not None
    assert pattern.yarn_material.tolist() == [1, 0, 2, 2]
