"""Imposed deformations of a fabric of spline yarns, to judge how well volumes follow all yarns (LOD03 §4, Fig. 2–8).

The published volume takes the shape, and its yarns keep their places in it. Of the homogenized volume the mid-surface
takes the shape, and its cells relax. Of all yarns one point a stitch along the four borders goes there, in damped
motion, and the rest relaxes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.errors import InputError
from yarnscale.fabric.holds import Holds
from yarnscale.fabric.measures import fibre_extension, penetration
from yarnscale.fabric.sheet_scene import SheetScene
from yarnscale.fabric.spline_knit import SplineFabric
from yarnscale.fabric.spline_motion import SplineMotion
from yarnscale.fabric.spline_points import SplinePoints
from yarnscale.fabric.spline_touch import SplineTouch
from yarnscale.fabric.volume import BoundingVolume
from yarnscale.motion.run import simulate
from yarnscale.motion.schedule import Schedule
from yarnscale.numerics.affine import FreeUnknowns, MappedObjective
from yarnscale.numerics.newton import NewtonOptions, minimise
from yarnscale.numerics.regularisation import ShiftRule
from yarnscale.numerics.sums import SumOfEnergies

Kind = Literal["flexion", "traction", "shear", "torsion"]
AMOUNTS: dict[Kind, float] = {"flexion": 1.5, "traction": 0.2, "shear": 0.3, "torsion": 1.5}
"""Angle over the size [rad] of flexion and torsion; relative elongation of traction; shear."""
AXES = ("rows", "wales")
_RAMP, _SETTLING, _DAMPING, _STEP = 0.1, 0.05, 20.0, 1 / 240
_PARTS = 5
"""Of a deformation, in which volumes follow it."""
_SHIFT = ShiftRule(start=0.0, lowest=1e-6, lowest_is_zero=True, least=1e-3)


def deformed(points: Array, kind: Kind, amount: float, size: float, axis: int = 0) -> Array:
    """Points (k, 3) [m] of a flat fabric of a size [m] along an axis, 0 (rows) or 1 (wales), in a deformation.

    flexion: rolled up along the axis to a cylinder; traction along it; shear: lines along it moved over each other;
    torsion about it. amount: as ``AMOUNTS``. Raises InputError.
    """
    if kind not in get_args(Kind):
        raise InputError("imposed deformation", expected=" or ".join(get_args(Kind)), found=kind)
    order = [0, 1, 2] if axis == 0 else [1, 0, 2]
    x, y, z = points[:, order].T
    if amount == 0.0:
        return points
    angle = amount / size * x
    if kind == "flexion":
        bent = size / amount - z
        x, z = bent * np.sin(angle), size / amount - bent * np.cos(angle)
    elif kind == "traction":
        x = (1.0 + amount) * x
    elif kind == "shear":
        x = x + amount * y
    else:
        y, z = np.cos(angle) * y - np.sin(angle) * z, np.sin(angle) * y + np.cos(angle) * z
    return np.stack([x, y, z], axis=1)[:, order]


@dataclass(frozen=True, eq=False, kw_only=True)
class ImposedScene(SheetScene):
    """Vertices ``nodes`` that go from ``rest`` (k, 3) [m] along a path, a map of points and a share of it."""

    nodes: Integers
    rest: Array
    path: Callable[[Array, float], Array]
    gravity: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0))

    def holds(self, time: float) -> Holds:
        """Held vertices and their targets at a time [s]."""
        return Holds(self.nodes, self.path(self.rest, min(time / _RAMP, 1.0)))


@dataclass(frozen=True, eq=False)
class ImposedShape:
    """Control points of the yarns (n, 3) [m] of a model; passages: of yarns on the way.

    converged: whether the model relaxed.
    """

    control: Array
    passages: int
    converged: bool

    def measures(self, fabric: SplineFabric) -> dict[str, float | int | bool]:
        """``penetration`` [diameters], largest ``extension`` of fibres and ``mean_extension``, ``passages``."""
        largest, mean = fibre_extension(fabric, self.control)
        found = {"penetration": penetration(fabric, self.control), "extension": largest, "mean_extension": mean}
        return {**found, "passages": self.passages, "converged": self.converged}


def imposed_shapes(
    fabric: SplineFabric, volume: BoundingVolume, kind: Kind, axis: int, *, amount: float | None = None
) -> dict[str, ImposedShape]:
    """All yarns, the published and the homogenized volume in a deformation: by the name of the model."""
    most = AMOUNTS[kind] if amount is None else amount
    if not (math.isfinite(most) and most != 0):
        raise InputError(f"amount of {kind}", expected="a number other than 0", found=most)
    knots = (volume.x_knots, volume.y_knots)[axis]
    size = float(knots[-4] - knots[3])

    def path(points: Array, share: float) -> Array:
        return deformed(points, kind, share * most, size, axis)

    weights = volume.weights(fabric.control.reshape(-1, 3))
    published = [weights @ faces for faces in _followed(volume, path)]
    return {
        "splines": _all_yarns(fabric, path),
        "published": ImposedShape(published[-1], passages_along(fabric, published), True),
        "homogenized": _relaxed_cells(fabric, volume, path),
    }


def _followed(volume: BoundingVolume, path: Callable[[Array, float], Array]) -> list[Array]:
    """Control points of a volume that takes the parts of a deformation."""
    return [volume.interpolated(lambda points, share=k / _PARTS: path(points, share)) for k in range(1, _PARTS + 1)]


def passages_along(fabric: SplineFabric, shapes: list[Array]) -> int:
    """Passages of yarns on straight paths from rest through shapes (n, 3) [m], but those that others undo."""
    touch, rows, before = SplineTouch(SplinePoints(fabric)), np.empty((0, 6)), fabric.control.ravel()
    for shape in shapes:
        rows, before = touch.passages(before, shape.ravel(), rows), shape.ravel()
    return touch.lasting(rows)


def border_nodes(points: SplinePoints) -> Integers:
    """One point a stitch along the first and the last row, and both ends of every row."""
    offsets, y = points.sheet.offsets, points.sheet.vertices[:, 1]
    stitches = len(points.fabric.top)
    rows = [np.array_split(np.arange(offsets[k], offsets[k + 1]), stitches) for k in (0, len(offsets) - 2)]
    low, high = ([part[pick(y[part])] for part in row] for row, pick in zip(rows, (np.argmin, np.argmax), strict=True))
    return np.unique(np.concatenate([low, high, offsets[:-1], offsets[1:] - 1]))


def _all_yarns(fabric: SplineFabric, path: Callable[[Array, float], Array]) -> ImposedShape:
    points = SplinePoints(fabric)
    nodes = border_nodes(points)
    loads = ImposedScene(nodes=nodes, rest=points.sheet.vertices[nodes], path=path)
    moving = SplineMotion(fabric, loads=loads, gravity=loads.gravity, damping=_DAMPING)
    run = simulate(moving, moving.start, Schedule(_RAMP + _SETTLING, _STEP, to_rest=False))
    return ImposedShape(run.state.positions, moving.touch.lasting(run.state.passages), run.converged)


def _relaxed_cells(
    fabric: SplineFabric, volume: BoundingVolume, path: Callable[[Array, float], Array]
) -> ImposedShape:  # fmt: skip
    moving = SplineMotion(fabric.unclosed(), volume=volume, reduction="homogenized")
    cells, x, count = moving.cells, moving.start.positions.ravel().copy(), 3 * volume.count // 2
    assert cells is not None
    places, shapes, converged = np.arange(count, x.size), [], True
    still = FreeUnknowns(places, np.zeros_like(x))
    for faces in _followed(volume, path):
        x[:count] = 0.5 * (faces[::2] + faces[1::2]).ravel()
        free = FreeUnknowns(places, x.copy())
        objective = MappedObjective(SumOfEnergies(cells, [], moving.force_scale), free)

        def bound(y: Array, step: Array, free: FreeUnknowns = free) -> float:
            return cells.bound(free.expand(y), still.expand(step))

        options = NewtonOptions(1e-1, max_iterations=100, shift=_SHIFT)
        solution = minimise(objective, x[places], options, bound=bound)
        x[places], converged = solution.x, solution.converged
        shapes.append(cells.yarns(x.reshape(-1, 3), np.zeros((x.size // 3, 3)))[0])
    return ImposedShape(shapes[-1], passages_along(fabric, shapes), converged)
