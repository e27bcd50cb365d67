"""Periods of a fabric in its photograph, from the autocorrelation of the brightness.

Pixels are (column, row) with rows downwards; the wale direction of the fabric is upwards.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.fft import next_fast_len

from yarnscale.arrays import Array
from yarnscale.errors import InputError

STEEPEST = 0.2
"""Largest slope of a lattice direction against the edges of the picture."""
NEARLY = 0.8
"""Share of the strongest repetition at which a shorter one counts as the period."""
LEAST_REPETITION = 0.1
"""Correlation of a picture with its shifted self below which nothing repeats."""
CLOSE = 0.15
"""Difference of a period from the known one, relative, within which it is looked for."""
FEWEST_PIXELS = 6
"""Shortest period that is looked for."""


@dataclass(frozen=True)
class Lattice:
    """Where one period of a fabric lies in a picture [pixels].

    origin: (2,) of the fabric's point (0, 0). course, wale: (2,), one period to the right and one upwards.
    """

    origin: Array
    course: Array
    wale: Array

    @property
    def matrix(self) -> Array:
        """Columns course and wale (2, 2)."""
        return np.column_stack([self.course, self.wale])

    def pixels(self, points: Array) -> Array:
        """Pixels (…, 2) of points (…, 2) given in periods."""
        return np.asarray(self.origin + points @ self.matrix.T)

    def periods(self, pixels: Array) -> Array:
        """Points (…, 2) in periods of pixels (…, 2)."""
        return np.asarray(np.linalg.solve(self.matrix, (pixels - self.origin).T).T, dtype=np.float64)


def even(brightness: Array) -> Array:
    """Brightness (rows, columns) without its slow changes, of equal contrast everywhere."""
    wide = min(brightness.shape) / 10.0
    flat = brightness - ndimage.gaussian_filter(brightness, wide)
    contrast = np.sqrt(ndimage.gaussian_filter(flat * flat, wide))
    return flat / np.maximum(contrast, 1e-6 * max(float(np.abs(flat).max()), 1e-12))


def lattice_of(flat: Array, near: tuple[float, float] | None = None) -> Lattice:
    """The lattice of an evened picture, its origin in the middle.

    near: known periods along the course and the wale direction [pixels], to which the picture's lie close.
    Raises InputError where nothing repeats along the rows or the columns.
    """
    repetition = _autocorrelation(flat)
    sizes = (None, None) if near is None else near
    course = _refined(repetition, _first_peak(repetition, "course", sizes[0]))
    wale = _refined(repetition, _first_peak(repetition, "wale", sizes[1]))
    return Lattice(0.5 * (np.array(flat.shape[::-1]) - 1.0), course, -wale)


def folded(flat: Array, lattice: Lattice, shape: tuple[int, int], *, most: int = 400) -> Array:
    """Mean brightness of one period (rows along the wale, columns along the course), over at most ``most`` periods."""
    rows, columns = shape
    cell = np.stack(np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows), -1)
    height, width = flat.shape
    corners = lattice.periods(np.array([(0, 0), (width, 0), (0, height), (width, height)], dtype=float))
    first, last = np.floor(corners.min(axis=0)).astype(int), np.ceil(corners.max(axis=0)).astype(int)
    tiles = np.stack(np.meshgrid(*(np.arange(a, b) for a, b in zip(first, last, strict=True))), -1).reshape(-1, 2)
    square = lattice.pixels(tiles[:, None] + np.array([(0, 0), (1, 0), (0, 1), (1, 1)]))
    inside = ((square >= 0) & (square <= np.array([width, height]) - 1)).all(axis=(1, 2))
    tiles = tiles[inside]
    if len(tiles) == 0:
        found = f"{np.abs(lattice.course[0]):.0f} × {np.abs(lattice.wale[1]):.0f} of {width} × {height} pixels"
        raise InputError("picture holds no whole period", expected="two periods or more each way", found=found)
    middle = lattice.periods(0.5 * np.array([width, height], dtype=float))
    nearest = np.argsort(np.abs(tiles + 0.5 - middle).sum(axis=1), kind="stable")[:most]
    total = np.zeros(shape)
    for tile in tiles[nearest]:
        at = lattice.pixels(cell + tile)
        total += ndimage.map_coordinates(flat, [at[..., 1], at[..., 0]], order=1, mode="nearest")
    return total / len(nearest)


def _autocorrelation(flat: Array) -> Array:
    """Correlation of a picture with itself, lag (0, 0) in the middle, up to half its size."""
    shape = tuple(int(next_fast_len(2 * n, real=True) or 0) for n in flat.shape)

    def correlated(values: Array) -> Array:
        return np.fft.irfft2(np.abs(np.fft.rfft2(values, shape)) ** 2, shape)

    overlap = correlated(np.ones_like(flat))
    found = np.fft.fftshift(correlated(flat - flat.mean()) / np.maximum(overlap, 1.0))
    middle, half = np.array(found.shape) // 2, np.array(flat.shape) // 2
    found = found[middle[0] - half[0] : middle[0] + half[0] + 1, middle[1] - half[1] : middle[1] + half[1] + 1]
    # The noise of the camera correlates with itself only at no lag at all.
    found = ndimage.gaussian_filter(found, 1.0)
    return found / max(float(found.max()), 1e-300)


def _first_peak(repetition: Array, name: str, near: float | None) -> Array:
    """The lag (2,) of the shortest repetition to the right, or downwards, that is nearly as strong as any."""
    across = name == "wale"
    values = repetition.T if across else repetition
    rows, columns = values.shape[0] // 2, values.shape[1] // 2
    along, side = np.arange(columns + 1), np.arange(-rows, rows + 1)
    part = values[:, columns:]
    reachable = (np.abs(side)[:, None] <= STEEPEST * along[None]) & (along >= FEWEST_PIXELS)[None]
    if near is not None:
        reachable &= np.abs(along / near - 1.0)[None] < CLOSE
    peaks = (ndimage.maximum_filter(part, 5) == part) & reachable
    if not peaks.any() or float(part[peaks].max()) < LEAST_REPETITION:
        raise InputError(
            f"nothing repeats along the {name} direction", found="no period",
            expected="a photograph of several periods, its wales upright",
        )  # fmt: skip
    row, column = np.nonzero(peaks & (part >= NEARLY * part[peaks].max()))
    chosen = np.argmin(column)
    lag = np.array([along[column[chosen]], side[row[chosen]]], dtype=float)
    return lag[::-1] if across else lag


def _refined(repetition: Array, lag: Array) -> Array:
    """The lag as a fraction of pixels, from its multiples as far as these repeat."""
    middle = np.array(repetition.shape[::-1]) // 2
    window = int(max(2, 0.2 * np.abs(lag).max()))
    weights, sums = 0.0, np.zeros(2)
    for multiple in range(1, 200):
        at = np.rint(multiple * lag).astype(int)
        low, high = middle + at - window, middle + at + window + 1
        if (low < 1).any() or (high > np.array(repetition.shape[::-1]) - 1).any():
            break
        part = repetition[low[1] : high[1], low[0] : high[0]]
        peak = np.array(np.unravel_index(np.argmax(part), part.shape))[::-1] + low
        if (np.abs(peak - middle - multiple * lag) > 0.8 * window).any() or part.max() < 0.5 * LEAST_REPETITION:
            break
        sums += multiple * (peak + _vertex(repetition, peak) - middle)
        weights += multiple * multiple
        lag = sums / weights
    return lag


def _vertex(values: Array, peak: NDArray[np.int64]) -> Array:
    """Offset (2,) of the top of the parabola through a maximum and its neighbours."""
    offset = np.zeros(2)
    for axis, step in enumerate(((0, 1), (1, 0))):
        low, here, high = (values[peak[1] + k * step[0], peak[0] + k * step[1]] for k in (-1, 0, 1))
        bend = low - 2.0 * here + high
        offset[axis] = 0.0 if bend >= 0.0 else np.clip(0.5 * (low - high) / bend, -0.5, 0.5)
    return offset
