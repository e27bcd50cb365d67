"""The bounding volume of LOD03 §3: two bicubic B-spline surfaces, joined linearly through the thickness.

Control points of yarns keep their place in the volume, so that ε = Γ α with a constant Γ. In the flat rest state the
volume's own parameters are x, y [m] and the share of the thickness, because B-splines reproduce straight lines.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline
from scipy.interpolate import insert as insert_knot
from scipy.sparse import csr_array, kron

from yarnscale.arrays import Array
from yarnscale.errors import InputError

DEGREE = 3
_MOST_DENSE = 300
"""Control points up to which Γ is multiplied as a dense matrix."""


@dataclass(frozen=True, eq=False)
class BoundingVolume:
    """A volume of (n1, n2, 2) control points, numbered with the thickness fastest and x slowest.

    x_knots, y_knots: of the cubic splines along x and y [m], n1 + 4 and n2 + 4; bottom, top: heights z [m] of the two
    surfaces at rest.
    """

    x_knots: Array
    y_knots: Array
    bottom: float
    top: float

    @classmethod
    def around(cls, points: ArrayLike, shape: tuple[int, int]) -> BoundingVolume:
        """The volume of uniform patches with ``shape`` = (n1, n2) control points around points (n, 3) [m] at rest.

        Raises InputError.
        """
        points = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        for count in shape:
            if not 4 <= count <= 1000:
                raise InputError("control points of a volume", expected="4 to 1000 in each direction", found=count)
        low, high = points.min(axis=0), points.max(axis=0)
        flat = np.flatnonzero(high - low <= 0)
        if len(flat):
            raise InputError(
                "points in a volume", expected="some extent in x, y and z", found=f"none in {'xyz'[flat[0]]}"
            )
        knots = [
            low[k] + (high[k] - low[k]) * np.arange(-DEGREE, count + 1) / (count - DEGREE)
            for k, count in enumerate(shape)
        ]
        return cls(knots[0], knots[1], float(low[2]), float(high[2]))

    @property
    def shape(self) -> tuple[int, int, int]:
        """Control points along x, along y and through the thickness."""
        return len(self.x_knots) - DEGREE - 1, len(self.y_knots) - DEGREE - 1, 2

    @property
    def count(self) -> int:
        """Number of control points."""
        return int(np.prod(self.shape))

    @property
    def control_at_rest(self) -> Array:
        """Control points (count, 3) [m] at which the volume is the box it was made as (Greville's abscissae)."""
        x, y = ((k[1:-3] + k[2:-2] + k[3:-1]) / 3.0 for k in (self.x_knots, self.y_knots))
        grid = np.meshgrid(x, y, [self.bottom, self.top], indexing="ij")
        return np.stack(grid, axis=-1).reshape(-1, 3)

    def along_y(self, low: float, high: float) -> BoundingVolume:
        """The volume with its patches from low to high [m] along y instead."""
        begin, end = self.y_knots[DEGREE], self.y_knots[-DEGREE - 1]
        return replace(self, y_knots=low + (self.y_knots - begin) * ((high - low) / (end - begin)))

    def weights(self, points: Array) -> csr_array:
        """Γ of points (n, 3) [m] given at rest: (n, count), at most 32 entries a row. Raises InputError outside."""
        x, y = _design(points[:, 0], self.x_knots, "x"), _design(points[:, 1], self.y_knots, "y")
        share = (points[:, 2] - self.bottom) / (self.top - self.bottom)
        across = csr_array(np.column_stack([1.0 - share, share]))
        return _row_products(_row_products(x, y), across)

    def fast_weights(self, points: Array) -> Array | csr_array:
        """``weights``, dense where products with them are then faster."""
        weights = self.weights(points)
        return weights.toarray() if self.count <= _MOST_DENSE else weights

    def interpolated(self, shape: Callable[[Array], Array]) -> Array:
        """Control points (count, 3) with which the volume takes a shape: a map of points at rest (k, 3) → (k, 3) [m].

        Exact at as many points, evenly spread over the surfaces, as there are control points.
        """
        n1, n2, n3 = self.shape
        x, y = (np.linspace(k[DEGREE], k[-DEGREE - 1], n) for k, n in ((self.x_knots, n1), (self.y_knots, n2)))
        grid = np.meshgrid(x, y, [self.bottom, self.top], indexing="ij")
        wanted = shape(np.stack(grid, axis=-1).reshape(-1, 3)).reshape(n1, n2 * n3 * 3)
        along = np.linalg.solve(_design(x, self.x_knots, "x").toarray(), wanted).reshape(n1, n2, n3 * 3)
        across = np.linalg.solve(_design(y, self.y_knots, "y").toarray()[None], along)
        return across.reshape(-1, 3)

    def refined(self, axis: int, value: float) -> tuple[BoundingVolume, csr_array]:
        """The volume with one more knot at ``value`` [m] along axis 0 (x) or 1 (y), and the map of control points.

        The shape and the velocity of the volume stay exactly what they were: control' = map @ control.
        """
        knots = (self.x_knots, self.y_knots)[axis]
        if not knots[DEGREE] < value < knots[-DEGREE - 1]:
            raise InputError("new knot", expected="a place inside the volume", found=value)
        finer, along = _insertion(knots, value)
        n1, n2, n3 = self.shape
        maps = (kron(along, np.eye(n2)), kron(np.eye(n1), along))[axis]
        volume = replace(self, **{("x_knots", "y_knots")[axis]: finer})
        return volume, csr_array(kron(maps, np.eye(n3)))


def _design(values: Array, knots: Array, name: str) -> csr_array:
    low, high = knots[DEGREE], knots[-DEGREE - 1]
    slack = 1e-9 * (high - low)
    if values.min(initial=low) < low - slack or values.max(initial=high) > high + slack:
        raise InputError(f"points in a volume along {name}", expected=f"{low:g} to {high:g} m", found="points outside")
    return csr_array(BSpline.design_matrix(np.clip(values, low, high), knots, DEGREE))


def _row_products(first: csr_array, second: csr_array) -> csr_array:
    """Row by row Kronecker product, (n, a) and (n, b) → (n, a·b)."""
    a, b = first.tocoo(), second
    _, width = cast("tuple[int, int]", second.shape)
    counts = np.diff(b.indptr)[a.row]
    begin = np.repeat(b.indptr[a.row], counts)
    place = begin + np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    rows, columns = np.repeat(a.row, counts), np.repeat(a.col, counts) * width + b.indices[place]
    values = np.repeat(a.data, counts) * b.data[place]
    height, length = cast("tuple[int, int]", first.shape)
    return csr_array((values, (rows, columns)), shape=(height, length * width))


def _insertion(knots: Array, value: float) -> tuple[Array, csr_array]:
    """Knots with one more, and the matrix that maps coefficients to the finer ones (Boehm)."""
    count = len(knots) - DEGREE - 1
    finer = np.insert(knots, np.searchsorted(knots, value, side="right"), value)
    columns = []
    for unit in np.eye(count):
        padded = np.concatenate([unit, np.zeros(DEGREE + 1)])
        _, coefficients, _ = cast("tuple[Array, Array, int]", insert_knot(value, (knots, padded, DEGREE)))
        columns.append(coefficients[: count + 1])
    return finer, csr_array(np.column_stack(columns))
