"""A homogenized volume: cells of spline yarns on the mid-surface of a volume."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from yarnscale.drawing.library import build, structure
from yarnscale.drawing.stitches import StitchChart
from yarnscale.errors import InputError
from yarnscale.fabric import spline_contacts
from yarnscale.fabric.adaptive_volume import AdaptiveVolume
from yarnscale.fabric.spline_knit import SplineFabric, jersey, spline_fabric
from yarnscale.fabric.spline_model import SplineEnergy
from yarnscale.fabric.spline_motion import SplineMotion
from yarnscale.fabric.spline_points import SplinePoints
from yarnscale.fabric.spline_touch import SplineTouch
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.fabric.volume_cells import VolumeCells
from yarnscale.numerics.newton import Status
from yarnscale.yarn.material import YarnMaterial

WOOL = YarnMaterial.preset("wool")


@pytest.fixture(scope="module")
def fabric() -> SplineFabric:
    return jersey(4, 5, WOOL)


@pytest.fixture(scope="module")
def volume(fabric: SplineFabric) -> BoundingVolume:
    return BoundingVolume.around(fabric.control, (4, 5))


@pytest.fixture(scope="module")
def cells(fabric: SplineFabric, volume: BoundingVolume) -> VolumeCells:
    return VolumeCells(SplineEnergy(fabric), volume)


def test_yarns_are_where_they_are_at_rest_and_turn_with_the_surface(
    fabric: SplineFabric, volume: BoundingVolume, cells: VolumeCells
) -> None:
    rest, still = fabric.control.reshape(-1, 3), np.zeros_like(cells.at_rest)
    np.testing.assert_allclose(cells.yarns(cells.at_rest, still)[0], rest, atol=1e-15)
    turn, shift = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix(), np.array([0.1, 0.2, -0.3])
    turned = cells.at_rest.copy()
    surface = volume.count // 2
    turned[:surface] = turned[:surface] @ turn.T + shift
    value, gradient = cells.gradient(turned.ravel())
    assert value < 1e-18 and np.abs(gradient).max() < 1e-9
    np.testing.assert_allclose(cells.yarns(turned, still)[0], rest @ turn.T + shift, atol=1e-14)


@pytest.mark.parametrize("narrow", [1.0, 0.7])
def test_derivatives(cells: VolumeCells, narrow: float, check_derivatives: Callable[[Any, np.ndarray], None]) -> None:
    """At rest nearly, and where yarns are pressed on each other."""
    rng, share = np.random.default_rng(0), [narrow, narrow, 1.0]
    x = (cells.at_rest * share).ravel() + 2e-4 * rng.standard_normal(cells.size)
    pressed = len(cells.touch.hessians(cells._of_cells(cells._placed(x).points))[0])
    assert narrow == 1.0 or pressed > 100
    check_derivatives(cells, x)


@pytest.mark.parametrize("name", ["jersey", "rib-1x1"])
def test_affine_stretch_has_the_energy_of_all_yarns(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With fluctuations of 0 and no springs at the stitches, cells are yarns in a published volume."""
    monkeypatch.setattr(spline_contacts, "_STIFFNESS", 0.0)
    if name == "jersey":
        fabric = jersey(4, 4, WOOL)
    else:
        fabric = spline_fabric(build(name), StitchChart.read(structure(name).chart), 4, 2, WOOL)
    yarns = SplineEnergy(fabric)
    cells = VolumeCells(yarns, BoundingVolume.around(fabric.control, (4, 4)))
    affine = np.array([[1.03, 0.02, 0.0], [0.02, 0.96, 0.0], [0.0, 0.0, 1.0]])
    stretched = (cells.at_rest @ affine.T).ravel()
    whole = yarns.value((fabric.control.reshape(-1, 3) @ affine.T).ravel())
    assert whole > 1e-6
    assert cells.value(stretched) == pytest.approx(whole, rel=1e-9)


def test_contact_of_cells_is_that_of_a_stitch_inside_of_all_yarns(cells: VolumeCells) -> None:
    """Every pair counts once: the energy of a stitch is a difference of fabrics with one row and column more."""
    narrow = np.array([0.7, 0.7, 1.0])

    def whole(rows: int, columns: int) -> float:
        fabric = jersey(rows, columns, WOOL)
        return SplineTouch(SplinePoints(fabric)).value((fabric.control.reshape(-1, 3) * narrow).ravel())

    stitch = whole(7, 7) - whole(6, 7) - whole(7, 6) + whole(6, 6)
    nodes = cells._of_cells(cells._placed((cells.at_rest * narrow).ravel()).points)
    assert stitch > 1e-7
    assert cells.touch.value(nodes) == pytest.approx(stitch * cells.touch.shares.sum(), rel=1e-9)


def test_twist_to_either_side_has_the_same_energy(fabric: SplineFabric, volume: BoundingVolume) -> None:
    """Loops of jersey are their own mirror image, whatever surface the yarns of a cell are laid on."""
    cells, energies = VolumeCells(SplineEnergy(fabric), volume), []
    for twist in (60.0, -60.0):
        control = cells.at_rest.copy()
        surface = volume.count // 2
        control[:surface, 2] = twist * control[:surface, 0] * control[:surface, 1]
        energies.append(cells.value(control.ravel()))
    assert energies[0] == pytest.approx(energies[1], rel=1e-6) and energies[0] > 1e-6


def test_falls_where_the_published_volume_hardly_moves(fabric: SplineFabric, volume: BoundingVolume) -> None:
    lowest = []
    for reduction in ("published", "homogenized"):
        moving = SplineMotion(fabric, volume=volume, reduction=reduction, held=fabric.top)  # type: ignore[arg-type]
        motion, begin = moving.start, sum(moving.energies(moving.start).values())
        for _ in range(6):
            step = moving.step(motion, 1 / 240)
            assert step.status is Status.CONVERGED
            motion = step.state
            assert sum(moving.energies(motion).values()) < begin  # implicit Euler only loses energy
            begin = sum(moving.energies(motion).values())
        assert moving.distances_from_places(motion)["held row"] < 1e-9
        lowest.append(float((moving.yarns(motion).positions - fabric.control.reshape(-1, 3))[:, 1].min()))
    assert lowest[1] < 5.0 * lowest[0] < 0.0


def test_refuses_what_it_cannot_do(fabric: SplineFabric, volume: BoundingVolume) -> None:
    with pytest.raises(InputError, match="implicit"):
        SplineMotion(fabric, volume=volume, reduction="homogenized", method="explicit")
    with pytest.raises(InputError, match="published"):
        AdaptiveVolume(SplineMotion(fabric, volume=volume, reduction="homogenized"))
    with pytest.raises(InputError, match="reduction"):
        SplineMotion(fabric, volume=volume, reduction="none")  # type: ignore[arg-type]
