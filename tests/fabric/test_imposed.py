"""Imposed deformations of spline yarns."""

from __future__ import annotations

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.fabric.imposed import AMOUNTS, Kind, border_nodes, deformed, imposed_shapes, passages_along
from yarnscale.fabric.spline_knit import SplineFabric, jersey
from yarnscale.fabric.spline_points import SplinePoints
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.yarn.material import YarnMaterial


@pytest.fixture(scope="module")
def fabric() -> SplineFabric:
    return jersey(3, 3, YarnMaterial.preset("wool"))


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("kind", list(AMOUNTS))
def test_a_flat_sheet_keeps_what_each_deformation_leaves_alone(kind: Kind, axis: int) -> None:
    """Flexion keeps all distances on the sheet, torsion those from its axis, traction widths, shear the area."""
    grid = np.stack(np.meshgrid(*2 * [np.linspace(-0.5, 0.5, 201)], indexing="ij"), axis=-1)
    flat = np.concatenate([grid, np.zeros((201, 201, 1))], axis=2)
    moved = deformed(flat.reshape(-1, 3), kind, AMOUNTS[kind], 1.0, axis).reshape(flat.shape)
    along, across = (np.diff(moved, axis=k) * 200.0 for k in (axis, 1 - axis))
    lengths = np.linalg.norm(along, axis=2), np.linalg.norm(across, axis=2)
    stretch = {"traction": 1.0 + AMOUNTS["traction"]}.get(kind, 1.0)
    if kind != "torsion":
        np.testing.assert_allclose(lengths[0], stretch, rtol=1e-4)
    if kind != "shear":
        np.testing.assert_allclose(lengths[1], 1.0, rtol=1e-4)
    else:
        normals = np.cross(along[:, :200] if axis == 0 else along[:200], across[:200] if axis == 0 else across[:, :200])
        np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1.0, rtol=1e-9)


def test_all_yarns_are_moved_at_their_borders_and_volumes_as_a_whole(fabric: SplineFabric) -> None:
    volume, amount = BoundingVolume.around(fabric.control, (4, 4)), 0.1
    shapes = imposed_shapes(fabric, volume, "traction", 0, amount=amount)
    found = {model: shape.measures(fabric) for model, shape in shapes.items()}
    assert list(found) == ["splines", "published", "homogenized"]
    assert all(of["converged"] and of["passages"] == 0 for of in found.values())
    points, rest = SplinePoints(fabric.unclosed()), fabric.control.reshape(-1, 3)
    nodes = border_nodes(points)
    wanted = points.positions(rest)[nodes] * [1.0 + amount, 1.0, 1.0]
    away = np.linalg.norm(points.positions(shapes["splines"].control)[nodes] - wanted, axis=1)
    assert away.max() < 0.2
    np.testing.assert_allclose(shapes["published"].control, rest * [1.0 + amount, 1.0, 1.0], atol=1e-9)
    assert found["splines"]["extension"] < 0.1 * found["published"]["extension"]
    assert 0.5 * amount < found["published"]["extension"] <= amount + 1e-9


def test_yarns_of_a_homogenized_volume_do_not_pass_where_they_have_no_slack_left(fabric: SplineFabric) -> None:
    """Without contact between the yarns of a cell and their copies, they pass through each other ten times."""
    volume = BoundingVolume.around(fabric.control, (4, 4))
    shapes = imposed_shapes(fabric, volume, "traction", 1)
    found = {model: shape.measures(fabric) for model, shape in shapes.items()}
    taut, full = found["homogenized"], found["splines"]
    assert taut["passages"] == full["passages"] == 0 and taut["converged"]
    assert taut["penetration"] < full["penetration"] + 0.1


def test_passages_along_shapes_are_counted_unless_they_are_undone(fabric: SplineFabric) -> None:
    """Turned inside out through its own plane, every loop passes through another."""
    squeezed = [fabric.control.reshape(-1, 3) * [1.0, 1.0, share] for share in (0.5, -0.5, -1.0)]
    assert passages_along(fabric, squeezed[:1]) == 0
    assert passages_along(fabric, squeezed) > 0
    assert passages_along(fabric, [*squeezed, fabric.control.reshape(-1, 3)]) == 0


def test_refuses_amounts_that_are_none(fabric: SplineFabric) -> None:
    volume = BoundingVolume.around(fabric.control, (4, 4))
    for amount in (0.0, np.nan, np.inf):
        with pytest.raises(InputError, match="amount of shear"):
            imposed_shapes(fabric, volume, "shear", 0, amount=amount)
    with pytest.raises(InputError, match="imposed deformation"):
        deformed(np.zeros((1, 3)), "twist", 1.0, 1.0)  # type: ignore[arg-type]
