"""Deformations imposed on a bounding volume, to judge how well the yarns in it follow (LOD03 §4, Fig. 2–8)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from yarnscale.errors import InputError
from yarnscale.fabric.volume import BoundingVolume

Array = NDArray[np.float64]
Imposed = Literal["flexion", "traction", "shear", "torsion"]


def _flexion(points: Array, amount: float, width: float) -> Array:
    """Rolled up along the rows to a cylinder, by an angle of ``amount`` [rad] over the width."""
    bend = amount / width
    angle, size = points[:, 0] * bend, 1.0 / bend - points[:, 2]
    return np.stack([size * np.sin(angle), points[:, 1], 1.0 / bend - size * np.cos(angle)], axis=1)


def _traction(points: Array, amount: float, width: float) -> Array:
    """Drawn along the rows to (1 + ``amount``) of the width."""
    return points * [1.0 + amount, 1.0, 1.0]


def _shear(points: Array, amount: float, width: float) -> Array:
    """Rows moved over each other, by ``amount`` times their distance."""
    return points + amount * points[:, [1]] * [1.0, 0.0, 0.0]


def _torsion(points: Array, amount: float, width: float) -> Array:
    """Twisted about the rows' direction, by ``amount`` [rad] over the width."""
    angle = amount / width * points[:, 0]
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([points[:, 0], c * points[:, 1] - s * points[:, 2], s * points[:, 1] + c * points[:, 2]], axis=1)


DEFORMATIONS: dict[str, Callable[[Array, float, float], Array]] = {
    "flexion": _flexion,
    "traction": _traction,
    "shear": _shear,
    "torsion": _torsion,
}


def imposed(volume: BoundingVolume, kind: Imposed, amount: float) -> Array:
    """Control points (count, 3) [m] of the volume, moved as the deformation says.

    amount: angle over the width [rad] of flexion and torsion; relative elongation of traction; shear. Raises
    InputError.
    """
    if kind not in DEFORMATIONS:
        raise InputError("imposed deformation", expected=" or ".join(DEFORMATIONS), found=kind)
    if not (math.isfinite(amount) and amount != 0):
        raise InputError(f"amount of {kind}", expected="a number other than 0", found=amount)
    width = float(volume.x_knots[-4] - volume.x_knots[3])
    return volume.interpolated(lambda points: DEFORMATIONS[kind](points, amount, width))
