"""What is seen of round yarns from the front and from the back: heights and normals on the pixels of one period."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from yarnscale.arrays import Array

FRONT, BACK = 1.0, -1.0
"""Sides: the sign of z towards the eye."""
_HOLLOWS = (1.5, 0.6)
"""Widths of the surroundings over which a point counts as hollow [r]."""
FEATURES = 4 + len(_HOLLOWS)
"""Fields on which brightness depends, but for a constant."""


@dataclass(frozen=True, eq=False)
class Relief:
    """A period of yarns as seen from one side; x to the right of the front, also for the back.

    normal: (rows, columns, 3), the last component towards the eye, 0 where no yarn is. height: (rows, columns) towards
    the eye, of the lowest yarn where there is none. segment: number of the segment that is seen, −1 for none.
    """

    normal: Array
    height: Array
    segment: NDArray[np.int64]

    @classmethod
    def of(cls, start: Array, end: Array, radius: Array, period: Array, shape: tuple[int, int], side: float) -> Relief:
        """The relief of segments (m, 3) to (m, 3) of radii (m,), repeated with the period (2,); all in one unit."""
        height, normal = np.full(shape, -np.inf), np.zeros((*shape, 3))
        segment = np.full(shape, -1)
        turned = np.array([1.0, 1.0, side])
        _draw(start * turned, end * turned, radius, period, height, normal, segment)
        low = height[segment >= 0].min(initial=0.0)
        return cls(normal, np.where(segment < 0, low, height), segment)

    def features(self, radius: float, pixel: tuple[float, float], blur: float) -> Array:
        """Fields (rows, columns, FEATURES + 1) on which brightness depends: normal, yarn or none, hollows, one.

        radius, pixel (height, width) and blur in one unit.
        """
        fields = [*np.moveaxis(self.normal, -1, 0), self.segment >= 0, *self._hollows(radius, pixel)]
        ones = np.ones((*self.height.shape, 1))
        return np.concatenate([np.stack([_smoothed(field, blur, pixel) for field in fields], -1), ones], -1)

    def lit(self, light: Array, radius: float, pixel: tuple[float, float], blur: float) -> Array:
        """Brightness (rows, columns): the features times ``light`` (FEATURES + 1,)."""
        bright = self.normal @ light[:3] + light[3] * (self.segment >= 0)
        for share, hollow in zip(light[4:], self._hollows(radius, pixel), strict=False):
            bright += share * hollow
        return _smoothed(bright, blur, pixel) + light[-1]

    def _hollows(self, radius: float, pixel: tuple[float, float]) -> list[Array]:
        return [(self.height - _smoothed(self.height, width * radius, pixel)) / radius for width in _HOLLOWS]


def _smoothed(field: Array, width: float, pixel: tuple[float, float]) -> Array:
    sizes = [width / pixel[0], width / pixel[1]]
    return ndimage.gaussian_filter(field.astype(np.float64), sizes, mode="wrap", truncate=3.0)


@numba.njit(cache=True, error_model="numpy")
def _draw(start, end, radius, period, height, normal, segment):
    rows, columns = height.shape
    wide, tall = period[0] / columns, period[1] / rows
    for m in range(start.shape[0]):
        px, py, pz = start[m]
        ux, uy, uz = end[m, 0] - px, end[m, 1] - py, end[m, 2] - pz
        length = np.sqrt(ux * ux + uy * uy + uz * uz)
        ux, uy, uz = ux / length, uy / length, uz / length
        r = radius[m]
        level = 1.0 - uz * uz
        if level < 1e-6:
            continue
        first, last = np.floor((min(px, end[m, 0]) - r) / wide), np.ceil((max(px, end[m, 0]) + r) / wide)
        below, above = np.floor((min(py, end[m, 1]) - r) / tall), np.ceil((max(py, end[m, 1]) + r) / tall)
        for i in range(int(below), int(above)):
            dy = (i + 0.5) * tall - py
            for j in range(int(first), int(last)):
                dx = (j + 0.5) * wide - px
                # The ray along z meets the cylinder where its distance from the axis is r.
                along = ux * dx + uy * dy
                root = uz * uz * along * along - level * (dx * dx + dy * dy - along * along - r * r)
                if root < 0.0:
                    continue
                h = (uz * along + np.sqrt(root)) / level
                s = along + h * uz
                if s < -0.15 * r or s > length + 0.15 * r:
                    continue
                a, b = i % rows, j % columns
                if pz + h > height[a, b]:
                    height[a, b] = pz + h
                    segment[a, b] = m
                    normal[a, b, 0] = (dx - s * ux) / r
                    normal[a, b, 1] = (dy - s * uy) / r
                    normal[a, b, 2] = (h - s * uz) / r
