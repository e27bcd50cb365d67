"""Ranges of the unknowns, R_est, and drawings of another aspect."""

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.drawing.library import build
from yarnscale.errors import InputError
from yarnscale.swatches.yarn_model import drawn_length, estimated_radius, reshaped, yarn_model


@pytest.fixture(scope="module")
def model():
    return yarn_model(build("stockinette"), 20.0, yarn_length=0.011, free_shape=True)


def test_values_and_unknowns_are_inverse(model):
    unknowns = np.random.default_rng(0).random(len(model.names))
    np.testing.assert_allclose(model.unknowns(model.values(unknowns)), unknowns, atol=1e-12)
    low, high = model.bounds
    np.testing.assert_allclose(model.values(np.zeros(8)), low, rtol=1e-12)
    np.testing.assert_allclose(model.values(np.ones(8)), high, rtol=1e-12)


def test_a_measured_bending_stiffness_narrows_its_range(model):
    low, high = replace(model, bending=2e-8).bounds
    place = model.names.index("k_b")
    assert low[place] < 2e-8 < high[place] < 1.6 * low[place]
    np.testing.assert_array_equal(np.delete(high, place), np.delete(model.bounds[1], place))
    with pytest.raises(InputError, match="k_b"):
        replace(model, bending=0.0)


def test_material_has_the_stiffnesses_asked_for(model):
    values = model.values(np.array([0.3, 0.5, 0.7, 0.6, 0.2, 0.5, 0.1, 0.9]))
    material, radius = model.material(values), model.pattern.radius
    assert material.stretch_stiffness(radius) == pytest.approx(values[0])
    assert material.stiff_stretch_stiffness(radius) == pytest.approx(20.0)
    assert material.bending_stiffness(radius) == pytest.approx(values[2])
    assert material.contact.outer_radius_ratio * radius == pytest.approx(values[3])
    assert material.contact_stiffness == pytest.approx(values[4])


def test_a_search_may_come_close_to_no_soft_phase(model):
    assert model.material(model.values(np.array([0.3, 5e-13, 0.7, 0.6, 0.2, 0.5, 0.1, 0.9]))).stretch.knee == 0.0


def test_estimated_radius_grows_with_the_drawing():
    pattern = build("plain")
    assert estimated_radius(pattern.scaled(2.0)) == pytest.approx(2.0 * estimated_radius(pattern), rel=1e-12)


def test_estimated_radius_lets_every_segment_touch_and_no_smaller_one_does():
    """By brute force over sampled points of segments."""
    pattern = build("stockinette")
    radius = estimated_radius(pattern)
    along = np.linspace(0.0, 1.0, 13)
    points = pattern.vertices[:, None] + along[:, None] * pattern.edge_vectors()[:, None]
    place, count = pattern.position_along_yarn, len(pattern.edges)
    nearest = np.full(count, np.inf)
    for a in range(-2, 3):
        for b in range(-3, 4):
            copies = points + np.array([a * pattern.period[0], b * pattern.period[1], 0.0])
            gaps = np.linalg.norm(points[:, None, :, None] - copies[None, :, None], axis=-1).min(axis=(2, 3))
            # How many segments lie between along the yarn, which runs on from tile to tile along x.
            tile = pattern.tile_along_yarn[:, 0]
            walked = place[None] - place[:, None] + count * (a - tile[None] + tile[:, None])
            own = (np.abs(walked) <= 3) & (b == 0)
            nearest = np.minimum(nearest, np.where(own, np.inf, gaps).min(axis=1))
    assert radius == pytest.approx(0.5 * nearest.max(), rel=0.02)


def test_reshaped_drawing_keeps_yarn_length_and_changes_aspect():
    pattern = build("stockinette")
    wider = reshaped(pattern, 1.5)
    assert drawn_length(wider) == pytest.approx(drawn_length(pattern), rel=1e-12)
    before, after = pattern.period[0] / pattern.period[1], wider.period[0] / wider.period[1]
    assert after / before == pytest.approx(1.5, rel=1e-12)
    assert wider.radius == pattern.radius
    np.testing.assert_allclose(wider.rest_length, wider.drawn_length, rtol=1e-9)


def test_refuses_a_yarn_without_stiffness():
    with pytest.raises(InputError, match="k_s2"):
        yarn_model(build("stockinette"), 0.0)
