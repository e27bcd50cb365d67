"""Topology, changed copies and checks of a yarn pattern."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.drawing.library import build, names
from yarnscale.errors import InputError
from yarnscale.files.pyp import read_pyp
from yarnscale.yarn.pattern import YarnPattern


def bending_and_stretch(pattern: YarnPattern) -> tuple[float, float]:
    """Two simple sums per area that any change of description must keep."""
    edge = np.linalg.norm(pattern.edge_vectors(), axis=1)
    joint = pattern.twist - pattern.twist[pattern.previous_vertex] + pattern.reference_twist
    stretch = (pattern.rest_length * (edge / pattern.rest_length - 0.98) ** 2).sum()
    twist = (joint**2 / pattern.voronoi_length).sum()
    return float(stretch / pattern.area), float(twist / pattern.area)


@pytest.mark.parametrize("name", names())
def test_yarns_are_closed_walks(name: str) -> None:
    pattern = build(name)
    assert sorted(np.concatenate(pattern.yarns).tolist()) == list(range(len(pattern.vertices)))
    assert (pattern.next_vertex[pattern.previous_vertex] == np.arange(len(pattern.vertices))).all()
    for index, chain in enumerate(pattern.yarns):
        assert (pattern.yarn_of_vertex[chain] == index).all()
        assert (pattern.next_vertex[chain] == np.roll(chain, -1)).all()
        assert pattern.position_along_yarn[chain].tolist() == list(range(len(chain)))
        assert tuple(pattern.yarn_shift[index]) in {(1, 0), (0, 1)}
    assert abs(pattern.vertices[:, 2].mean()) < 1e-12


def test_edges_start_at_their_row_in_the_published_file(shared) -> None:
    pattern = read_pyp(shared / "reference" / "stockinette.pyp")
    assert (pattern.edges[:, 0] == np.arange(100)).all()
    # Were the rows of *E taken for those of *RL, the lengths would be off by far more than 1 %.
    length = np.linalg.norm(pattern.edge_vectors(), axis=1)
    assert np.abs(pattern.rest_length / length - 1.0).max() < 0.005
    assert pattern.yarn_shift.tolist() == [[1, 0], [1, 0]]
    assert pattern.area == pytest.approx(0.0150513 * 0.00793099)


@pytest.mark.parametrize("name", ["stockinette", "rib-2x2", "twill-2x2"])
def test_a_supercell_is_the_same_fabric(name: str) -> None:
    pattern = build(name, rest_shape="current")
    cell = pattern.repeated(2, 3)
    assert len(cell.vertices) == 6 * len(pattern.vertices)
    assert cell.area == pytest.approx(6 * pattern.area)
    assert bending_and_stretch(cell) == pytest.approx(bending_and_stretch(pattern), rel=1e-12)
    assert np.allclose(cell.edge_vectors(), np.tile(pattern.edge_vectors(), (6, 1)), atol=1e-15)
    courses = (pattern.yarn_shift == [1, 0]).all(axis=1).sum()
    warps = len(pattern.yarns) - courses
    assert len(cell.yarns) == courses * 3 + warps * 2


def test_one_tile_repeated_once_is_itself() -> None:
    pattern = build("plain")
    assert pattern.repeated(1, 1).content_hash() == pattern.content_hash()


def test_moving_and_retiling_keep_the_fabric() -> None:
    pattern = build("garter")
    rng = np.random.default_rng(1)
    for changed in (
        pattern.shifted(0.3e-3, -2e-3),
        pattern.retiled(rng.integers(-3, 4, (len(pattern.vertices), 2))),
        pattern.wrapped(),
    ):
        assert np.allclose(changed.edge_vectors(), pattern.edge_vectors(), atol=1e-15)
        assert (changed.yarn_shift == pattern.yarn_shift).all()
        assert bending_and_stretch(changed) == pytest.approx(bending_and_stretch(pattern))
    inside = pattern.wrapped().vertices[:, :2] / pattern.period
    assert inside.min() >= 0.0
    assert inside.max() < 1.0


def test_scaling_multiplies_lengths_only() -> None:
    pattern = build("stockinette", rest_shape="current")
    small = pattern.scaled(0.1)
    assert small.radius == pytest.approx(1e-4)
    assert np.allclose(small.rest_length, 0.1 * pattern.rest_length)
    assert np.allclose(small.edge_vectors(), 0.1 * pattern.edge_vectors())
    assert (small.rest_curvature == pattern.rest_curvature).all()


def test_the_hash_sees_content_but_not_the_name() -> None:
    pattern = build("plain")
    assert replace(pattern, name="other").content_hash() == pattern.content_hash()
    assert replace(pattern, twist=-0.0 * pattern.twist).content_hash() == pattern.content_hash()
    vertices = pattern.vertices.copy()
    vertices[3, 1] = np.nextafter(vertices[3, 1], 1.0)
    assert replace(pattern, vertices=vertices).content_hash() != pattern.content_hash()


@pytest.mark.parametrize(
    ("field", "change", "message"),
    [
        ("radius", lambda p: -1e-3, r"radius must be positive; expected > 0 m; found -0.001"),
        ("radius", lambda p: float("nan"), r"radius must be positive"),
        ("radius", lambda p: 1.0, r"radius is too large for the period"),
        ("period", lambda p: [0.0, 1e-2], r"period\[0\] must be positive"),
        ("rest_length", lambda p: p.rest_length * 0, r"rest_length\[0\] must be positive"),
        (
            "rest_length",
            lambda p: p.rest_length[:-1],
            r"rest_length has the wrong shape; expected \(32,\); found",
        ),
        ("vertices", lambda p: p.vertices * np.nan, r"vertices\[0, 0\] must be finite"),
        ("vertices", lambda p: np.zeros((0, 3)), r"vertices must be a non-empty table"),
        ("vertices", lambda p: p.vertices * 1e9, r"vertices lie too far out"),
        ("twist", lambda p: ["a"] * 32, r"twist must hold numbers"),
        ("edges", lambda p: p.edges[::-1], r"edges\[0\] must start at vertex 0"),
        (
            "edges",
            lambda p: p.edges + np.array([0, 99, 0, 0]),
            r"edges\[0\] ends at a vertex that is not there",
        ),
        ("edges", lambda p: p.edges * [1, 0, 1, 1], r"vertex 0 must have one incoming edge.*found 32"),
        ("edges", lambda p: p.edges + 0.5, r"edges must hold integers"),
        ("edges", lambda p: p.edges * [1, 1, 99999, 1], r"edges reach too many tiles away"),
        ("reference_director", lambda p: 2 * p.reference_director, r"reference_director\[0\] must be a unit"),
        (
            "reference_director",
            lambda p: p.edge_vectors() / np.linalg.norm(p.edge_vectors(), axis=1)[:, None],
            r"reference_director\[0\] must be perpendicular to its edge; expected cosine 0; found cosine 1",
        ),
    ],
)
def test_impossible_values_are_named(field: str, change, message: str) -> None:
    pattern = build("plain")
    with pytest.raises(InputError, match=message):
        replace(pattern, **{field: change(pattern)})


def test_an_edge_without_length_is_named() -> None:
    pattern = build("plain")
    vertices = pattern.vertices.copy()
    vertices[5] = vertices[4]
    with pytest.raises(InputError, match=r"edges\[4\] has no usable length"):
        replace(pattern, vertices=vertices)


def test_yarn_materials_follow_the_yarns() -> None:
    pattern = replace(build("plain"), yarn_material=np.array([0, 1, 2, 3]))
    assert (pattern.material_of_vertex == pattern.yarn_of_vertex).all()
    tiled = pattern.repeated(1, 2)
    assert tiled.yarn_material is not None
    # Warp yarns join their copies, weft yarns stand twice.
    assert sorted(tiled.yarn_material.tolist()) == [0, 0, 1, 1, 2, 3]
    assert (tiled.material_of_vertex == np.tile(pattern.material_of_vertex, 2)).all()
    assert pattern.content_hash() != build("plain").content_hash()
    same = replace(pattern, yarn_material=None)
    assert same.content_hash() == build("plain").content_hash()


@pytest.mark.parametrize("wrong", [[0], [0, 0, 0, -1], [0, 0, 0, 0.5], [0, 0, 0, 100]])
def test_wrong_yarn_materials_are_named(wrong: list[float]) -> None:
    with pytest.raises(InputError, match="yarn_material"):
        replace(build("plain"), yarn_material=np.array(wrong))
