"""Uniform cubic B-splines: values and derivatives on one segment of four control points."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from yarnscale.arrays import Array, Integers

ORDER = 4
"""Control points that act on one segment."""

_MATRIX = np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0
"""Row k: coefficients of u^k of the four blending functions."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(ORDER)
GAUSS_POINTS = 0.5 * (_NODES + 1.0)
"""Points on [0, 1]; exact to degree 7, so that products of two blending functions (degree 6) are."""
GAUSS_WEIGHTS = 0.5 * _WEIGHTS


def blending(u: ArrayLike, derivative: int = 0) -> Array:
    """Blending functions, or their derivative by u, at u in [0, 1]: shape u.shape + (4,)."""
    matrix = _MATRIX
    for _ in range(derivative):
        matrix = np.arange(1, len(matrix))[:, None] * matrix[1:]
    u = np.asarray(u, dtype=np.float64)
    return np.stack([u**k for k in range(len(matrix))], axis=-1) @ matrix


def control_of_periodic(samples: Array) -> Array:
    """Control points of the periodic spline through samples (n, d) at the knots: point i acts most at knot i.

    (c_{i−1} + 4 c_i + c_{i+1})/6 = sample_i, a circulant system.
    """
    spectrum = (4.0 + 2.0 * np.cos(2.0 * np.pi * np.arange(len(samples)) / len(samples))) / 6.0
    return np.real(np.fft.ifft(np.fft.fft(samples, axis=0) / spectrum[:, None], axis=0))


def segment_and_place(position: ArrayLike, segments: int) -> tuple[Integers, Array]:
    """Segment and place within it, in [0, 1], of curve parameters in [0, segments]."""
    position = np.asarray(position, dtype=np.float64)
    segment = np.clip(np.floor(position).astype(np.int64), 0, segments - 1)
    return segment, position - segment
