"""Pear loops against the heavy elastica, solved as a boundary value problem, and exact derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from yarnscale.errors import InputError
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.swatches.measurements import Direction
from yarnscale.swatches.pear_loop import PearLoop


def fabric(weft: float, bias: float | None = None, warp: float | None = None) -> OrthotropicMaterial:
    stiff = OrthotropicMaterial(500.0, 0.0, 500.0, 200.0, density=0.2)
    return replace(stiff, bend_weft=weft, bend_bias=bias or weft, bend_warp=warp or weft)


def elastica(stiffness: float, load: float, length: float, distance: float) -> float:
    """Aspect ratio of a heavy elastica [N m² / m, N/m²], hung by ends that leave two clamps straight down.

    Half the loop in units of the length: x' = cos θ, z' = sin θ, B θ'' = (weight below) cos θ + H sin θ.
    """
    along = np.linspace(0.0, 0.5, 61)
    half = distance / length / 2

    def solve(weight: float, mesh: np.ndarray, guess: np.ndarray, pull: np.ndarray):
        def slopes(s: np.ndarray, y: np.ndarray, p: np.ndarray) -> np.ndarray:
            cosine, sine = np.cos(y[2]), np.sin(y[2])
            return np.array([cosine, sine, y[3], weight * (0.5 - s) * cosine + p[0] * sine])

        def ends(a: np.ndarray, b: np.ndarray, p: np.ndarray) -> np.ndarray:
            return np.array([a[0], a[1], a[2] + np.pi / 2, b[0] - half, b[2]])

        return solve_bvp(slopes, ends, mesh, guess, p=pull, tol=1e-8, max_nodes=20000)

    angle = -np.pi / 2 + np.pi * along - 0.8 * np.sin(2 * np.pi * along)
    turning = np.gradient(angle, along)
    steps = np.diff(along)[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])[1:]
    path = np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)])
    solution = (along, np.array([path[:, 0], path[:, 1], angle, turning]), np.zeros(1))
    weight = load * length**3 / stiffness
    for part in np.append(0.0, np.geomspace(min(1.0, weight), weight, 8)):
        found = solve(part, *solution)
        assert found.success
        solution = (found.x, found.y, found.p)
    x, z = found.sol(np.linspace(0.0, 0.5, 4001))[:2]
    return -z.min() / (2 * (half - x.min()))


@pytest.mark.parametrize("stiffness", [3e-5, 3e-6])
@pytest.mark.parametrize("direction", Direction)
def test_loops_of_every_direction_are_elasticas_to_one_percent(direction, stiffness):
    distances = np.array([0.003, 0.013, 0.034])
    response = PearLoop(direction).respond(fabric(stiffness), distances)
    expected = [elastica(2 * stiffness, 0.2 * 9.81, 0.1, distance) for distance in distances]
    assert response.converged.all()
    np.testing.assert_allclose(response.ratio, expected, rtol=0.01)


def test_only_stiffness_over_weight_counts():
    loop = PearLoop(Direction.WEFT, segments=15)
    light = loop.respond(fabric(1e-6), [0.02])
    heavy = loop.respond(replace(fabric(3e-6), density=0.6), [0.02])
    assert heavy.ratio[0] == pytest.approx(light.ratio[0], rel=1e-3)


def test_every_direction_feels_its_stiffness():
    """Along weft and warp a loop is a cylinder: it feels one stiffness alone."""
    uneven = fabric(2e-6, 5e-6, 8e-6)
    for direction, stiffness in ((Direction.WEFT, 2e-6), (Direction.WARP, 8e-6)):
        loop = PearLoop(direction, segments=15)
        found, alike = loop.respond(uneven, [0.01]), loop.respond(fabric(stiffness), [0.01])
        assert found.ratio[0] == pytest.approx(alike.ratio[0], rel=2e-3)


def test_refinement_changes_the_ratio_by_less_than_two_percent():
    distances, cloth = [0.003, 0.034], fabric(3e-6)
    coarse = PearLoop(Direction.WEFT).respond(cloth, distances)
    fine = PearLoop(Direction.WEFT, segments=71).respond(cloth, distances)
    np.testing.assert_allclose(coarse.ratio, fine.ratio, rtol=0.02)


@pytest.mark.parametrize("direction", [Direction.WEFT, Direction.BIAS])
def test_derivatives_are_finite_differences(direction):
    loop, cloth, distances = PearLoop(direction, segments=15), fabric(3e-6, 2.5e-6, 5e-6), [0.01, 0.03]
    response = loop.respond(cloth, distances)
    names = ("bend_weft", "bend_bias", "bend_warp")
    exact = loop.derivatives(cloth, response, names)
    for k, name in enumerate(names):
        step = 1e-3 * getattr(cloth, name)
        above, below = (
            loop.respond(replace(cloth, **{name: getattr(cloth, name) + s}), distances, near=response)
            for s in (step, -step)
        )
        difference = (above.ratio - below.ratio) / (2 * step)
        np.testing.assert_allclose(exact[:, k], difference, rtol=1e-3, atol=1e-4 * np.abs(exact).max())


def test_curvature_of_a_loop_is_that_of_its_shape():
    loop = PearLoop(Direction.WEFT)
    weightless = replace(fabric(1e-5), density=1e-4)
    response = loop.respond(weightless, [0.0636])  # nearly the half circle that just fits
    assert loop.largest_curvature(response.positions[0]) == pytest.approx(np.pi / 0.1, rel=0.03)


@pytest.mark.parametrize("distance", [0.0, -0.01, 0.07, np.nan])
def test_distances_that_make_no_loop_are_refused(distance):
    with pytest.raises(InputError, match="distance"):
        PearLoop(Direction.WEFT, segments=15).respond(fabric(1e-6), [distance])
