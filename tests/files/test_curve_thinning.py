"""Curves of fewer points, and tubes about them that fit into a size."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.files.curve_frames import CurveSet
from yarnscale.files.tube_detail import BYTES_PER_VERTEX, LARGEST_PIECE, Tubes, fitting_detail, thinned

TURNS = np.linspace(0.0, 40.0, 4000)
HELIX = np.column_stack([np.cos(TURNS), np.sin(TURNS), 0.1 * TURNS])
LINE = np.linspace(0.0, 1.0, 50)[:, None] * [1.0, 2.0, -1.0]
CURVES = CurveSet([0, 4000, 4050, 8050], 0.05, closed=[False, False, True], yarn=[0, 1, 0])
POINTS = np.concatenate([HELIX, LINE, HELIX * [1.0, 1.0, 0.01] + [5.0, 0.0, 0.0]])


@pytest.mark.parametrize("tolerance", [1e-4, 1e-3, 1e-2, 0.1, 10.0])
def test_points_left_out_lie_near_what_is_left(tolerance: float) -> None:
    few, kept = thinned(CURVES, POINTS, tolerance)
    assert len(few) == 3 and (few.closed == CURVES.closed).all() and (few.yarn == CURVES.yarn).all()
    assert few.point_count < CURVES.point_count
    for start in (*CURVES.offsets[:-1], *(CURVES.offsets[1:] - 1)):
        assert start in kept
    for curve in range(3):
        own = kept[(kept >= CURVES.offsets[curve]) & (kept < CURVES.offsets[curve + 1])]
        for a, b in pairwise(own):
            along = POINTS[b] - POINTS[a]
            share = np.clip((POINTS[a : b + 1] - POINTS[a]) @ along / (along @ along), 0.0, 1.0)
            miss = POINTS[a : b + 1] - POINTS[a] - share[:, None] * along
            assert np.linalg.norm(miss, axis=1).max() <= tolerance * (1 + 1e-9)


def test_sagitta_sets_how_many_points_of_a_circle_stay() -> None:
    """A chord over an angle α of a unit circle misses it by 1 − cos(α/2)."""
    angles = np.linspace(0.0, 2 * np.pi, 2001)
    circle = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    few, _ = thinned(CurveSet([0, 2001], 0.1), circle, 0.0)
    assert few.point_count == 2001
    few, _ = thinned(CurveSet([0, 201], 0.1), circle[::10], 1e-2)
    assert few.point_count == pytest.approx(1 + 2 * np.pi / (2 * np.arccos(1 - 1e-2)), rel=0.15)


def test_tubes_are_as_fine_as_a_size_allows() -> None:
    before = None
    for size in (5e6, 1e6, 3e5, 8e4):
        level, taken = fitting_detail(CURVES, POINTS, size)
        tubes = Tubes.of(CURVES, POINTS, level)
        vertices, normals = tubes.surface(POINTS, CURVES.radii)
        assert len(vertices) * BYTES_PER_VERTEX == taken <= size
        assert before is None or (level.sides, -level.tolerance) <= (before.sides, -before.tolerance)
        before = level
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
        assert {colour for _, _, colour in tubes.pieces} == {0, 1}
        covered = np.concatenate([np.arange(len(vertices))[rows] for rows, _, _ in tubes.pieces])
        np.testing.assert_array_equal(covered, np.arange(len(vertices)))
        for rows, triangles, _ in tubes.pieces:
            count = rows.stop - rows.start
            assert triangles.max() == count - 1 and triangles.min() == 0 and count <= LARGEST_PIECE
    with pytest.raises(InputError, match=r"--megabytes .* or more, --yarns-as lines, or --format usd"):
        fitting_detail(CURVES, POINTS, 100.0)
