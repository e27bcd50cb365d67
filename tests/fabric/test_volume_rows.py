"""Full yarns at the borders of a homogenized volume."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from yarnscale.drawing.library import build, structure
from yarnscale.drawing.stitches import StitchChart
from yarnscale.errors import InputError
from yarnscale.fabric import spline_contacts
from yarnscale.fabric.sheet_scene import SheetScene
from yarnscale.fabric.spline_knit import CurvePoints, SplineFabric, jersey, spline_fabric
from yarnscale.fabric.spline_model import SplineEnergy
from yarnscale.fabric.spline_motion import SplineMotion
from yarnscale.fabric.spline_points import SplinePoints
from yarnscale.fabric.spline_touch import SplineTouch
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.fabric.volume_cells import VolumeCells
from yarnscale.fabric.volume_rows import RowsOnCells, cells_of, rows_of_cells
from yarnscale.numerics.newton import Status
from yarnscale.yarn.material import YarnMaterial

WOOL = YarnMaterial.preset("wool")


def _around(fabric: SplineFabric, inner: range) -> RowsOnCells:
    return RowsOnCells(SplineEnergy(fabric), BoundingVolume.around(fabric.control, (4, 5)), inner)


@pytest.fixture(scope="module")
def fabric() -> SplineFabric:
    return jersey(5, 4, WOOL)


@pytest.fixture(scope="module")
def mixed(fabric: SplineFabric) -> RowsOnCells:
    return _around(fabric, range(1, 4))


def test_which_rows_are_full_yarns(fabric: SplineFabric) -> None:
    assert rows_of_cells(fabric, fabric.top) == range(1, 3)
    assert rows_of_cells(jersey(7, 2, WOOL), jersey(7, 2, WOOL).top) == range(1, 5)
    assert rows_of_cells(fabric, None) == range(1, 5)
    assert rows_of_cells(fabric.unclosed(), None) == range(5)
    assert rows_of_cells(jersey(2, 2, WOOL), jersey(2, 2, WOOL).top) == range(1)
    volume = BoundingVolume.around(fabric.control, (4, 4))
    assert isinstance(cells_of(SplineEnergy(fabric.unclosed()), volume, None, loaded=False), VolumeCells)
    for yarns in ([2], [0, 4], [0, 1, 2, 3, 4]):
        with pytest.raises(InputError, match="held rows"):
            rows_of_cells(fabric, CurvePoints(np.array(yarns), np.full(len(yarns), 3.0)))


def test_rows_turn_with_the_surface_and_weigh_as_all_yarns(fabric: SplineFabric, mixed: RowsOnCells) -> None:
    rest, still = fabric.control.reshape(-1, 3), np.zeros_like(mixed.at_rest)
    np.testing.assert_allclose(mixed.yarns(mixed.at_rest, still)[0], rest, atol=1e-15)
    turn, shift = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix(), np.array([0.1, 0.2, -0.3])
    turned, heavy = mixed.at_rest.copy(), len(mixed.weight(np.zeros(3))) // 3
    turned[:heavy] = turned[:heavy] @ turn.T + shift
    value, gradient = mixed.gradient(turned.ravel())
    assert value < 1e-18 and np.abs(gradient).max() < 1e-9
    np.testing.assert_allclose(mixed.yarns(turned, still)[0], rest @ turn.T + shift, atol=1e-14)
    mass, moved = SplineEnergy(fabric).masses.sum(), np.ones(heavy)
    assert moved @ mixed.mass_matrix() @ moved == pytest.approx(mass)
    assert mixed.weight(np.array([0.0, -9.81, 0.0]))[1::3].sum() == pytest.approx(-9.81 * mass)
    places = mixed.rows(csr_array(np.eye(rest.size))) @ mixed.at_rest.ravel()
    flat = fabric.control.copy()
    flat[1:4, :, 2] = 0.0  # within the volume points count as on the mid-surface
    np.testing.assert_allclose(places, flat.ravel(), atol=1e-15)


@pytest.mark.parametrize("narrow", [1.0, 0.7])
def test_derivatives(mixed: RowsOnCells, narrow: float, check_derivatives: Callable[[Any, np.ndarray], None]) -> None:
    """At rest nearly, and where yarns are pressed on each other."""
    rng = np.random.default_rng(0)
    x = (mixed.at_rest * [narrow, narrow, 1.0]).ravel() + 2e-4 * rng.standard_normal(mixed.size)
    pressed = [border.rows.touch.value(border.control(x).ravel()) for border in mixed._borders]
    assert narrow == 1.0 or min(pressed) > 0.0
    check_derivatives(mixed, x)


@pytest.mark.parametrize("name", ["jersey", "garter"])
def test_affine_stretch_has_the_energy_of_all_yarns(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With fluctuations of 0 and no springs at the stitches, each row counts once."""
    monkeypatch.setattr(spline_contacts, "_STIFFNESS", 0.0)
    if name == "jersey":
        fabric = jersey(5, 4, WOOL)
    else:
        fabric = spline_fabric(build(name), StitchChart.read(structure(name).chart), 3, 2, WOOL)
    mixed, affine = _around(fabric, range(1, 4)), np.array([[1.03, 0.02, 0.0], [0.02, 0.96, 0.0], [0.0, 0.0, 1.0]])
    whole = SplineEnergy(fabric).value((fabric.control.reshape(-1, 3) @ affine.T).ravel())
    assert whole > 1e-6
    assert mixed.value((mixed.at_rest @ affine.T).ravel()) == pytest.approx(whole, rel=1e-9)


def test_contact_of_some_yarns_is_what_they_add(fabric: SplineFabric) -> None:
    def touch(part: SplineFabric, **own: np.ndarray) -> float:
        narrow = part.control.reshape(-1, 3) * [0.7, 0.7, 1.0]
        return SplineTouch(SplinePoints(part), **own).value(narrow.ravel())

    added = touch(fabric) - touch(fabric.part(0, 4))
    assert touch(fabric, own=np.array([4])) == pytest.approx(added, rel=1e-9) and added > 1e-7


def test_falls_as_all_yarns_do(fabric: SplineFabric) -> None:
    drops = []
    for inside in ({}, {"volume": BoundingVolume.around(fabric.control, (4, 4)), "reduction": "homogenized"}):
        moving = SplineMotion(fabric, held=fabric.top, damping=40.0, **inside)  # type: ignore[arg-type]
        motion, energy = moving.start, 0.0
        for _ in range(8):
            step = moving.step(motion, 1 / 240)
            assert step.status is Status.CONVERGED
            motion = step.state
            if inside:  # implicit Euler only loses energy
                before, energy = energy, sum(moving.energies(motion).values())
                assert energy < before
        assert moving.distances_from_places(motion)["held row"] < 1e-9 and not moving.touch.lasting(motion.passages)
        drops.append((moving.yarns(moving.start).positions - moving.yarns(motion).positions)[:, 1].mean())
    assert drops[1] == pytest.approx(drops[0], rel=0.1) and drops[0] > 2e-4


def test_held_points_are_refused_beside_loads(fabric: SplineFabric) -> None:
    volume = BoundingVolume.around(fabric.control, (4, 5))
    loads = SheetScene((0.0, -9.81, 0.0))
    with pytest.raises(InputError, match="none beside loads"):
        SplineMotion(fabric, volume=volume, reduction="homogenized", held=fabric.top, loads=loads)
