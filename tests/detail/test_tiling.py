"""Patterns laid over panels: nothing missing, nothing twice, whole yarns, none across a seam."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.detail.tiling import SHORTEST, YarnLayout
from yarnscale.drawing import library
from yarnscale.errors import InputError
from yarnscale.shell.mesh import TriangleMesh, rectangle
from yarnscale.yarn.pattern import YarnPattern


def copies(pattern: YarnPattern, layout: YarnLayout) -> np.ndarray:
    """(tile, vertex) of every yarn vertex, (n, 3)."""
    tiles = (layout.material - pattern.vertices[layout.vertex, :2]) / pattern.period
    assert np.abs(tiles - np.rint(tiles)).max() < 1e-9
    return np.column_stack([np.rint(tiles).astype(np.int64), layout.vertex])


@pytest.mark.parametrize("name", ["stockinette", "twill-2x2"])
def test_every_copy_inside_is_there_once_and_joined_to_the_next(name: str) -> None:
    pattern = library.build(name)
    mesh = rectangle(0.06, 0.05, 0.009, irregularity=0.25)
    layout = YarnLayout.of(pattern, mesh)
    found = copies(pattern, layout)
    assert len(np.unique(found, axis=0)) == len(found)

    ranges = [np.arange(-40, 41) for _ in range(2)]
    tiles = np.stack(np.meshgrid(*ranges, indexing="ij"), -1).reshape(-1, 1, 2)
    every = (pattern.vertices[None, :, :2] + tiles * pattern.period).reshape(-1, 2)
    # All copies but those on snippets at the border, which are shorter than a stitch.
    margin = np.array([0.03, 0.025]) - SHORTEST * pattern.radius
    well_inside = (np.abs(every) < margin).all(axis=1).sum()
    assert (np.abs(layout.material) < margin).all(axis=1).sum() == well_inside
    assert layout.vertex_count <= (np.abs(every) < [0.03, 0.025]).all(axis=1).sum()

    ends = layout.offsets[1:-1]
    for k in np.setdiff1d(np.arange(layout.vertex_count - 1), ends - 1):
        edge = pattern.edges[layout.vertex[k]]
        np.testing.assert_array_equal(found[k + 1], [*(found[k, :2] + edge[2:]), edge[1]])
    assert not layout.closed.any()
    np.testing.assert_array_equal(
        np.repeat(layout.yarn, np.diff(layout.offsets)), pattern.yarn_of_vertex[layout.vertex]
    )


def test_the_place_in_the_triangle_is_the_material_point() -> None:
    mesh = rectangle(0.04, 0.04, 0.007, grain=0.4)
    pattern = library.build("stockinette")
    layout = YarnLayout.of(pattern, mesh)
    assert layout.place.min() > -1e-8
    np.testing.assert_allclose(layout.place.sum(axis=1), 1.0, atol=1e-12)
    copies(pattern, layout)  # on the lattice


def test_yarns_laid_out_alone_end_at_a_seam() -> None:
    one = rectangle(0.05, 0.05, 0.008)
    # The same panel twice, sewn along the right border of the first and the left one of the second.
    right = np.flatnonzero(one.panel[:, 0] > 0.025 - 1e-9)
    left = np.flatnonzero(one.panel[:, 0] < -0.025 + 1e-9)
    count = len(one.material)
    other = np.arange(count, 2 * count)
    other[left] = right
    vertices = np.unique(other, return_inverse=True)[1]
    spatial = np.concatenate([np.arange(count), np.where(np.isin(other, right), other, 0)])
    spatial[count:][vertices >= len(right)] = count + np.arange(count - len(right))
    corners = np.concatenate([one.corners, one.corners + count])
    points = np.concatenate([one.material, one.material])
    assembled = np.zeros((2 * count - len(right), 3))
    assembled[spatial[:count], :2] = one.material
    assembled[spatial[count:], :2] = one.material + np.array([0.05, 0.0])
    mesh = TriangleMesh(points, spatial[corners], 0.0, corners, assembled)

    pattern = library.build("stockinette")
    alone, both = YarnLayout.of(pattern, one), YarnLayout.of(pattern, mesh)
    # Each panel has the yarns it has alone, and at the seam the snippets too that a free border is rid of.
    for panel, near in ((0, 0.025), (1, -0.025)):
        own = both.panel == panel
        assert (both.triangle[own] // len(one.triangles) == panel).all()
        inner = own & (np.abs(both.material[:, 0] - near) > 0.02)
        there = np.abs(alone.material[:, 0] - near) > 0.02
        np.testing.assert_array_equal(both.vertex[inner], alone.vertex[there])
        np.testing.assert_allclose(both.material[inner], alone.material[there], atol=1e-12)
        assert len(alone.vertex) < own.sum()


def test_a_panel_smaller_than_the_pattern_is_refused() -> None:
    with pytest.raises(InputError, match="panels larger than the pattern"):
        YarnLayout.of(library.build("stockinette"), rectangle(2e-4, 2e-4, 1e-4))
    with pytest.raises(InputError, match="copies of vertices"):
        YarnLayout.of(library.build("stockinette"), rectangle(300.0, 300.0, 30.0))
