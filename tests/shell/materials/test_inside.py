"""Terms of three in-plane strains and of both curvatures: the formula, its derivatives, its bounds, what is refused."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.interpolate import CubicSpline as SmoothSpline

from yarnscale.errors import InputError
from yarnscale.shell.materials.inside import COUPLING, SHAPES, SOLIDS, InsideTerms
from yarnscale.shell.materials.spline_material import SplineMaterial
from yarnscale.shell.materials.spline_patches import INSIDE_PARAMETER_COUNT
from yarnscale.shell.materials.tables import CubicSpline

KAPPA = 130.0
KNOTS = (np.linspace(-0.5, 0.6, 5), np.linspace(-0.5, 0.6, 4), np.linspace(-0.5, 0.6, 6))


def smooth_shape(rng: np.random.Generator) -> CubicSpline:
    knots = np.linspace(-90, 110, 6)
    values = rng.normal(size=6)
    return CubicSpline(knots, values, SmoothSpline(knots, values)(knots, 1))


def inside(seed: int = 0) -> tuple[InsideTerms, np.ndarray]:
    """C² terms from random values at knots, and those values (SOLIDS, n, m, k)."""
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(SOLIDS, *(len(k) for k in KNOTS)))
    nodal = np.empty((SOLIDS, 2, 2, 2, *values.shape[1:]))
    for orders in product((0, 1), repeat=3):
        data = values
        for axis, (knots, order) in enumerate(zip(KNOTS, orders, strict=True)):
            data = SmoothSpline(knots, data, axis=axis + 1)(knots, order)
        nodal[:, orders[0], orders[1], orders[2]] = data
    shapes = [tuple(smooth_shape(rng) for _ in range(SHAPES)) for _ in range(2)]
    return InsideTerms(KNOTS, nodal, shapes[0], shapes[1], KAPPA), values


def material(seed: int = 0) -> SplineMaterial:
    axes = [CubicSpline(np.array([-1.0, 1.0]), np.zeros(2), np.zeros(2))] * 3
    axes += [CubicSpline(np.array([-100.0, 0.0, 100.0]), np.ones(3), np.zeros(3))] * 2
    return SplineMaterial(0.0, tuple(axes), {}, density=0.2, inside=inside(seed)[0])


def by_definition(terms: InsideTerms, values: np.ndarray, strain: np.ndarray) -> float:
    """The formula with eigenvectors and interpolating splines, for states within the knots."""
    solids = values
    for knots, place in zip(KNOTS, strain[:3], strict=True):
        solids = np.asarray(SmoothSpline(knots, solids, axis=1)(place))
    second = np.array([[strain[3], strain[4]], [strain[4], strain[5]]])
    curvatures, vectors = np.linalg.eigh(second)
    total = solids[0]
    for family, shapes in enumerate((terms.shapes_x, terms.shapes_y)):
        for m, shape in enumerate(shapes):
            matrix = vectors @ np.diag(shape(curvatures)) @ vectors.T
            total += solids[1 + family * SHAPES + m] * matrix[family, family]
    x11, x12, x22 = strain[3:] / KAPPA
    return float(total + solids[COUPLING] * (x11 * x22 + x12**2) / (1 + x11**2 + 2 * x12**2 + x22**2))


def states(count: int, seed: int = 3) -> np.ndarray:
    strains = np.random.default_rng(seed).uniform(-0.45, 0.55, (count, 6))
    strains[:, 3:] *= 150
    return strains


def test_energy_is_the_formula():
    terms, values = inside()
    strains = states(200)
    expected = [2.0 + by_definition(terms, values, strain) for strain in strains]
    np.testing.assert_allclose(material().energy_density(strains), expected, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("outside", [1.0, 1.7])
def test_stress_and_moduli_are_derivatives(outside):
    ours, step = material(1), np.array([1e-5] * 3 + [1e-3] * 3)
    for strain in outside * states(20, seed=5):
        pairs = strain + np.concatenate([np.diag(step), -np.diag(step)])
        energy, stress = ours.energy_density(pairs), ours.stress(pairs)
        found = ours.stress(strain)
        slopes = (energy[:6] - energy[6:]) / (2 * step)
        np.testing.assert_allclose(found * step, slopes * step, atol=1e-5 * np.abs(found * step).max())
        moduli = (stress[:6] - stress[6:]) / (2 * step[:, None])
        weight = np.outer([1, 1, 1, 100, 100, 100], [1, 1, 1, 100, 100, 100])
        difference = np.abs(ours.moduli(strain) - moduli) * weight
        assert np.max(difference) < 1e-3 * np.max(np.abs(moduli) * weight)


def test_nothing_steps_where_eigenvalues_meet_at_a_knot():
    ours, gaps = material(2), np.logspace(-9, -2, 30)
    knot = ours.inside.shapes_x[0].knots[2]  # type: ignore[union-attr]
    strains = np.tile([0.1, -0.2, 0.2, knot, 0.0, knot], (30, 1))
    strains[:, 3] += gaps
    strains[:, 5] -= gaps
    limit = ours.stress(strains[0])
    weight = np.array([1, 1, 1, 100, 100, 100])
    assert np.max(np.abs(ours.stress(strains) - limit) * weight / gaps[:, None]) < 100


def test_the_coupling_leaves_cylinders_along_the_axes_alone_and_is_bounded():
    ours = material(3)
    assert ours.inside is not None
    plain = replace(ours, inside=ours.inside.without_coupling())
    bent = states(100, seed=7)
    bent[:, 4] = 0.0
    bent[:50, 3] = 0.0
    bent[50:, 5] = 0.0
    np.testing.assert_allclose(ours.energy_density(bent), plain.energy_density(bent), rtol=1e-12)
    moment = (ours.stress(bent) - plain.stress(bent))[:, 3:]
    assert np.abs(moment[:50, 0]).min() > 0
    assert not moment[:, 1].any()
    wide = states(500, seed=8)
    wide[:, 3:] *= np.logspace(-2, 6, 500)[:, None]
    added = ours.energy_density(wide) - plain.energy_density(wide)
    # A number g within the values at knots, as a spline of C² data overshoots little, times at most a half.
    assert np.abs(added).max() < 2 * np.abs(inside(3)[1][COUPLING]).max()


def test_more_parameters_only_where_needed():
    assert material().parameter_count == INSIDE_PARAMETER_COUNT
    plain = SplineMaterial(0.0, material().axes, {}, density=0.2)
    assert plain.parameter_count < INSIDE_PARAMETER_COUNT


def test_misshapen_terms_are_refused():
    terms = inside()[0]
    with pytest.raises(InputError, match="three-dimensional"):
        InsideTerms(terms.knots, terms.nodal[:3], terms.shapes_x, terms.shapes_y, KAPPA)
    with pytest.raises(InputError, match="shapes_y"):
        InsideTerms(terms.knots, terms.nodal, terms.shapes_x, terms.shapes_y[:1], KAPPA)
    with pytest.raises(InputError, match="knots"):
        replace(terms, knots=(terms.knots[0][::-1], *terms.knots[1:]))
    for curvature in (0.0, -1.0, np.inf):
        with pytest.raises(InputError, match="curvature"):
            replace(terms, curvature=curvature)
