"""Checks of the single fields of a pattern."""

from __future__ import annotations

import numpy as np

from yarnscale.errors import InputError

LARGEST_LENGTH = 1e3
"""No length of a pattern exceeds this [m]; larger numbers are a mistaken unit."""
SMALLEST_LENGTH = 1e-9
"""No radius, period or rest length is smaller than this [m]."""
LARGEST_ANGLE = 1e4
"""No twist or integrated curvature of a pattern exceeds this [rad]."""
LARGEST_MATERIAL_COUNT = 100


def first_true(mask: np.ndarray) -> int | None:
    """Index of the first true entry."""
    return int(np.argmax(mask)) if mask.any() else None


def float_array(field: str, value: object, shape: tuple[int, ...]) -> np.ndarray:
    """A finite float array of the shape; InputError naming the field otherwise."""
    try:
        array = np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError) as error:
        raise InputError(f"{field} must hold numbers", expected=f"shape {shape}", found=error) from None
    if array.shape != shape:
        raise InputError(f"{field} has the wrong shape", expected=shape, found=array.shape)
    finite = np.isfinite(array)
    if not finite.all():
        index = tuple(int(i) for i in np.argwhere(~finite)[0])
        place = ", ".join(map(str, index))
        raise InputError(f"{field}[{place}] must be finite", expected="a finite number", found=array[index])
    return array


def edge_array(value: object, n: int) -> np.ndarray:
    """Rows (v0, v1, dx, dy) of n closed chains, row i starting at vertex i; InputError otherwise."""
    array = np.asarray(value)
    if array.shape != (n, 4):
        raise InputError("edges has the wrong shape", expected=(n, 4), found=array.shape)
    if array.dtype.kind not in "iu" and not (array.dtype.kind == "f" and (array == np.rint(array)).all()):
        raise InputError("edges must hold integers", expected="rows (v0, v1, dx, dy)", found=array.dtype)
    edges = np.array(array, dtype=np.int64, order="C")
    if (bad := first_true(edges[:, 0] != np.arange(n))) is not None:
        raise InputError(
            f"edges[{bad}] must start at vertex {bad}", expected=f"v0 = {bad}", found=f"v0 = {edges[bad, 0]}"
        )
    if (bad := first_true((edges[:, 1] < 0) | (edges[:, 1] >= n))) is not None:
        raise InputError(
            f"edges[{bad}] ends at a vertex that is not there", expected=f"0 ≤ v1 < {n}", found=f"v1 = {edges[bad, 1]}"
        )
    incoming = np.bincount(edges[:, 1], minlength=n)
    if (bad := first_true(incoming != 1)) is not None:
        raise InputError(f"vertex {bad} must have one incoming edge", expected="1 edge", found=f"{incoming[bad]} edges")
    if np.abs(edges[:, 2:]).max() > 10_000:
        raise InputError("edges reach too many tiles away", expected="|dx|, |dy| ≤ 10000")
    return edges


def check_angle(field: str, value: np.ndarray) -> None:
    """Integrated twists and curvatures are of a size that a yarn can have."""
    if (bad := first_true(np.abs(value).reshape(len(value), -1).max(axis=1) > LARGEST_ANGLE)) is not None:
        expected = f"at most {LARGEST_ANGLE:g} rad in size"
        raise InputError(f"{field}[{bad}] is too large", expected=expected, found=value[bad])


def material_array(value: object, yarns: int) -> np.ndarray:
    """Material numbers of the yarns, 0 where none are given; InputError for what numbers no material."""
    array = np.zeros(yarns, dtype=np.int64) if value is None else np.asarray(value)
    if array.shape != (yarns,):
        raise InputError("yarn_material has the wrong shape", expected=(yarns,), found=array.shape)
    if array.dtype.kind not in "iu" or (array < 0).any() or (array >= LARGEST_MATERIAL_COUNT).any():
        expected = f"integers from 0 to {LARGEST_MATERIAL_COUNT - 1}"
        raise InputError("yarn_material must number materials", expected=expected, found=array.tolist()[:8])
    return np.array(array, dtype=np.int64)


def radius_array(value: object, radius: float, yarns: int) -> np.ndarray | None:
    """Radii of the yarns, the largest of them ``radius``; None where all are. InputError for others."""
    if value is None:
        return None
    array = float_array("yarn_radius", value, (yarns,))
    check_length("yarn_radius", array)
    if abs(array.max() - radius) > 1e-9 * radius:
        raise InputError("radius must be the largest of yarn_radius", expected=f"{array.max():g} m", found=radius)
    return None if (array == radius).all() else array


def check_length(field: str, value: np.ndarray) -> None:
    """Every length is positive, finite and of a size that metres can mean."""
    if (bad := first_true(~(value > 0.0))) is not None:
        place = "" if field == "radius" else f"[{bad}]"
        raise InputError(f"{field}{place} must be positive", expected="> 0 m", found=f"{value[bad]:g}")
    if (bad := first_true(~((value >= SMALLEST_LENGTH) & (value <= LARGEST_LENGTH)))) is not None:
        place = "" if field == "radius" else f"[{bad}]"
        raise InputError(
            f"{field}{place} is no length in metres",
            expected=f"{SMALLEST_LENGTH:g} to {LARGEST_LENGTH:g} m",
            found=f"{value[bad]:g}",
        )
