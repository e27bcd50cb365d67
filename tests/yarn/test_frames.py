"""Conventions of frames, curvature and twist, against closed forms and the published patterns."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.drawing.curves import PeriodicCurve, pattern_from_curves
from yarnscale.files.pyp import read_pyp
from yarnscale.yarn.frames import (
    carried_along,
    material_curvature,
    parallel_transport,
    reference_twist,
    signed_angle,
)


def tangents(pattern) -> np.ndarray:
    edge = pattern.edge_vectors()
    return edge / np.linalg.norm(edge, axis=1)[:, None]


def random_units(seed: int, count: int) -> np.ndarray:
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def test_transport_is_the_smallest_rotation() -> None:
    before, after, vector = random_units(0, 50), random_units(1, 50), random_units(2, 50)
    assert np.allclose(parallel_transport(before, before, after), after, atol=1e-12)
    axis = np.cross(before, after)
    assert np.allclose(parallel_transport(axis, before, after), axis, atol=1e-12)
    assert np.allclose(np.linalg.norm(parallel_transport(vector, before, after), axis=1), 1.0)


def test_signed_angle_turns_about_the_axis() -> None:
    x, y, z = np.eye(3)[:, None, :]
    assert signed_angle(x, y, z) == pytest.approx(np.pi / 2)
    assert signed_angle(y, x, z) == pytest.approx(-np.pi / 2)


@pytest.mark.parametrize("name", ["stockinette", "satin"])
def test_the_published_reference_twists_follow_from_the_directors(shared, name: str) -> None:
    pattern = read_pyp(shared / "reference" / f"{name}.pyp")
    twist = reference_twist(tangents(pattern), pattern.reference_director, pattern.previous_vertex)
    # The file has six digits.
    assert np.abs(twist - pattern.reference_twist).max() < 1e-5
    assert np.abs(pattern.reference_twist).max() > 0.1


@pytest.mark.parametrize("name", ["stockinette", "satin"])
def test_the_published_rest_curvatures_are_those_of_the_material_frames(shared, name: str) -> None:
    """The published patterns are relaxed from their rest shape: they stay near it."""
    pattern = read_pyp(shared / "reference" / f"{name}.pyp")
    frames = (tangents(pattern), pattern.reference_director)
    here = material_curvature(*frames, pattern.twist, pattern.previous_vertex)
    rest = pattern.rest_curvature
    agreement = (here * rest).sum() / np.sqrt((here**2).sum() * (rest**2).sum())
    assert agreement > (0.85 if name == "stockinette" else 0.99)
    for wrong in (
        here[:, ::-1],
        here * [1, -1],
        here * [-1, 1],
        np.roll(here, 1, axis=0),
        np.roll(here, -1, axis=0),
    ):
        assert (wrong * rest).sum() / np.sqrt((here**2).sum() * (rest**2).sum()) < agreement - 0.1
    joint = pattern.twist - pattern.twist[pattern.previous_vertex] + pattern.reference_twist
    scatter = np.abs(joint - pattern.rest_twist).mean()
    flipped = pattern.twist - pattern.twist[pattern.previous_vertex] - pattern.reference_twist
    assert scatter < 0.5 * np.abs(flipped - pattern.rest_twist).mean()


def helix(count: int = 200, turns: int = 3) -> tuple[PeriodicCurve, np.ndarray]:
    """A helix about x of radius 2 mm that closes after one period of 30 mm."""
    u = np.arange(count) / count
    angle = 2 * np.pi * turns * u
    points = np.column_stack([0.03 * u, 2e-3 * np.cos(angle), 2e-3 * np.sin(angle)])
    return PeriodicCurve(points, (1, 0)), np.array([0.03, 0.02])


def test_a_helix_has_the_curvature_and_twist_of_the_closed_form() -> None:
    curve, period = helix(count=800)
    pattern = pattern_from_curves([curve], period, 1e-4, rest_shape="current")
    pitch = 0.03 / (2 * np.pi * 3)
    square = 2e-3**2 + pitch**2
    curvature, torsion = 2e-3 / square, pitch / square
    bent = np.linalg.norm(pattern.rest_curvature, axis=1) / pattern.voronoi_length
    assert np.abs(bent / curvature - 1.0).max() < 1e-3
    # The Frenet frame closes after one period; transport lags behind it by the whole torsion, modulo 2π.
    lag = torsion * curve.length(period)
    total = pattern.reference_twist.sum()
    assert np.cos(total - lag) == pytest.approx(1.0, abs=1e-3)
    assert np.sin(total - lag) == pytest.approx(0.0, abs=1e-2)


def test_a_pattern_from_curves_is_twisted_evenly() -> None:
    curve, period = helix()
    for shape in ("straight", "current"):
        pattern = pattern_from_curves([curve], period, 1e-4, rest_shape=shape)
        joint = pattern.twist - pattern.twist[pattern.previous_vertex] + pattern.reference_twist
        assert np.ptp(joint) < 1e-10
        assert (pattern.rest_length * pattern.twist).sum() == pytest.approx(0.0, abs=1e-12)
        assert np.abs(pattern.reference_twist[1:]).max() < 1e-12
        assert np.allclose(pattern.rest_length, pattern.drawn_length)
        t = tangents(pattern)
        assert np.abs((t * pattern.reference_director).sum(axis=1)).max() < 1e-14
        if shape == "straight":
            assert not pattern.rest_curvature.any()
            assert not pattern.rest_twist.any()
        else:
            assert np.allclose(pattern.rest_twist, joint)


def test_a_director_is_carried_from_edge_to_edge() -> None:
    generator = np.random.default_rng(4)
    tangent = np.array([2.0, 0.0, 0.0]) + np.cumsum(0.3 * generator.standard_normal((12, 3)), axis=0)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    start = np.cross(tangent[0], (0.0, 0.0, 1.0))
    carried = carried_along(start / np.linalg.norm(start), tangent)
    assert np.allclose((carried * tangent).sum(axis=1), 0.0, atol=1e-14)
    assert np.allclose(parallel_transport(carried[:-1], tangent[:-1], tangent[1:]), carried[1:], atol=1e-14)
