"""The clamped stretch test: closed forms without clamps, refinement, balance, exact derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.shell.materials.stiffening import StiffeningMaterial
from yarnscale.swatches.measurements import Direction
from yarnscale.swatches.swatch import StretchSwatch
from yarnscale.swatches.uniaxial import uniaxial

FABRIC = OrthotropicMaterial(60.0, 20.0, 100.0, 25.0, area=10.0, log_area=5.0)
STIFFENING = StiffeningMaterial(
    40.0,
    60.0,
    8.0,
    12.0,
    5.0,
    6.0,
    2.0,
    -1.0,
    90.0,
    40.0,
    coupling=40.0,
    shear=20.0,
    shear_rate=1.5,
    log_area=0.5,
)
STRETCH = np.array([0.1, 0.2, 0.3])
SHAPES = [(0.10, 0.06), (0.037, 0.096)]


@pytest.mark.parametrize("direction", [Direction.WEFT, Direction.WARP])
def test_without_clamps_a_swatch_is_a_uniform_strip(direction):
    response = StretchSwatch(direction, clamped=False).respond(FABRIC, STRETCH)
    stress, contraction = uniaxial(FABRIC, direction.angle, STRETCH)
    np.testing.assert_allclose(response.force / 0.06, stress, rtol=1e-8)
    np.testing.assert_allclose(response.contraction, contraction, rtol=1e-8)


@pytest.mark.parametrize(("length", "width"), SHAPES)
@pytest.mark.parametrize("direction", Direction)
def test_refinement_changes_the_output_by_less_than_two_percent(direction, length, width):
    """Twice uniformly subdivided, as in EST22 §5.1."""
    coarse = StretchSwatch(direction, length, width).respond(FABRIC, STRETCH[-1:])
    fine = StretchSwatch(direction, length, width, elements=40).respond(FABRIC, STRETCH[-1:])
    assert coarse.converged.all() and fine.converged.all()
    assert coarse.force[0] == pytest.approx(fine.force[0], rel=0.01)
    assert coarse.contraction[0] == pytest.approx(fine.contraction[0], rel=0.02)


def test_long_swatches_approach_the_uniform_strip():
    stress, _ = uniaxial(FABRIC, 0.0, STRETCH[:1])
    gaps = []
    for length in (0.1, 0.4):
        response = StretchSwatch(Direction.WEFT, length, 0.05, elements=6).respond(FABRIC, STRETCH[:1])
        gaps.append(abs(response.force[0] / 0.05 / stress[0] - 1))
    # The clamps stiffen two ends about as long as the swatch is wide.
    assert gaps[1] == pytest.approx(gaps[0] / 4, rel=0.1)
    # Far from them the swatch is uniform, stretched as its force demands.
    stretch = np.linspace(0.09, 0.11, 201)
    stress, contraction = uniaxial(FABRIC, 0.0, stretch)
    assert response.contraction[0] == pytest.approx(np.interp(response.force[0] / 0.05, stress, contraction), rel=1e-4)


@pytest.mark.parametrize("direction", Direction)
def test_both_clamps_pull_with_the_force_that_does_the_work(direction):
    swatch = StretchSwatch(direction)
    response = swatch.respond(FABRIC, np.array([0.2 - 1e-4, 0.2, 0.2 + 1e-4]))
    forces = swatch.shell.forces(FABRIC, response.positions[1])
    left = swatch.mesh.panel[:, 0] < 0
    np.testing.assert_allclose(forces[left].sum(axis=0), -forces[~left].sum(axis=0), atol=1e-9)
    energies = []
    for k in (0, 2):
        swatch.shell.energy.material = FABRIC
        energies.append(swatch.shell.energy.value(response.positions[k]))
    assert (energies[1] - energies[0]) / (2e-4 * swatch.length) == pytest.approx(response.force[1], rel=1e-5)


@pytest.mark.parametrize("fabric", [FABRIC, STIFFENING])
@pytest.mark.parametrize("direction", [Direction.WEFT, Direction.BIAS])
def test_derivatives_are_finite_differences(direction, fabric):
    swatch = StretchSwatch(direction, 0.037, 0.096, gauge_width=0.07, elements=6)
    names = fabric.MEMBRANE
    response = swatch.respond(fabric, STRETCH)
    exact = swatch.derivatives(fabric, response, names)
    for k, name in enumerate(names):
        step = 1e-3 * getattr(fabric, name)
        above, below = (
            swatch.respond(replace(fabric, **{name: getattr(fabric, name) + s}), STRETCH, near=response)
            for s in (step, -step)
        )
        force = (above.force - below.force) / (2 * step)
        # Equilibria are exact to 1e-8 of the forces that hold them, which the step divides.
        unfelt = 1e-8 / abs(step)
        contraction = (above.contraction - below.contraction) / (2 * step)
        np.testing.assert_allclose(
            exact[:, 0, k],
            force,
            rtol=1e-4,
            atol=max(1e-5 * np.abs(force).max(), unfelt * response.force.max()),
        )
        np.testing.assert_allclose(
            exact[:, 1, k], contraction, rtol=1e-4, atol=max(1e-5 * np.abs(contraction).max(), unfelt)
        )


def test_a_large_stretch_is_reached_in_one_go():
    response = StretchSwatch(Direction.BIAS, elements=6).respond(FABRIC, [1.5])
    assert response.converged.all()


@pytest.mark.parametrize("change", [{"length": -0.1}, {"width": 0.0}, {"gauge_width": 0.07}, {"gauge_width": -0.01}])
def test_swatches_without_size_are_refused(change):
    with pytest.raises(InputError):
        StretchSwatch(Direction.WEFT, **change)


def test_stretches_must_rise():
    with pytest.raises(InputError, match="rising"):
        StretchSwatch(Direction.WEFT).respond(FABRIC, [0.2, 0.1])
