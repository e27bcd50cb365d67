"""Closest points of a vertex and a triangle, and of two edges, and bounds on their motion.

A pair is four vertices x; its closest points are r = Σ c x apart. For a vertex and a triangle c = (1, −w₁, −w₂, −w₃),
for two edges c = (1 − s, s, t − 1, −t). A coefficient that is exactly zero means that the closest point is on a border.
"""

from __future__ import annotations

import math

import numba
import numpy as np

_FLAT = 1e-14
"""Squared sine of the corner of a triangle, or between edges, from which on there is an inner closest point."""
_MOST_ADVANCES = 300


@numba.njit(cache=True, error_model="numpy", nogil=True)
def closest_points(x, is_corner, c):
    """Set the coefficients c (4,) of the closest points of a pair x (4, 3); the squared distance."""
    return _of_corner(x, c) if is_corner else _of_edges(x, c)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def triangle_weights(points, corners):
    """Barycentric weights (n, 3) of the points of triangles (n, 3, 3) that are closest to points (n, 3)."""
    weights, x, c = np.empty((len(points), 3)), np.empty((4, 3)), np.empty(4)
    for n in range(len(points)):
        x[0], x[1:] = points[n], corners[n]
        closest_points(x, True, c)
        weights[n] = -c[1:]
    return weights


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _of_corner(x, c):
    aa, ab, bb, ra, rb = _products(x, 1, 2, 1, 3, 0)
    area = aa * bb - ab * ab
    c[0] = 1.0
    if area > _FLAT * aa * bb:
        u, v = (bb * ra - ab * rb) / area, (aa * rb - ab * ra) / area
        if u > 0.0 and v > 0.0 and u + v < 1.0:
            c[1], c[2], c[3] = u + v - 1.0, -u, -v
            return _square(x, c)
    best, side, share = math.inf, 1, 0.0
    for i in range(1, 4):
        s, square = _on_edge(x, 0, i, i % 3 + 1)
        if square < best:
            best, side, share = square, i, s
    c[1] = c[2] = c[3] = 0.0
    c[side], c[side % 3 + 1] = share - 1.0, -share
    return best


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _of_edges(x, c):
    aa, ab, bb, ra, rb = _products(x, 0, 1, 2, 3, 0)
    area = aa * bb - ab * ab
    if area > _FLAT * aa * bb:
        s, t = (ab * rb - bb * ra) / area, (aa * rb - ab * ra) / area
        if 0.0 < s < 1.0 and 0.0 < t < 1.0:
            c[0], c[1], c[2], c[3] = 1.0 - s, s, t - 1.0, -t
            return _square(x, c)
    best, end, share = math.inf, 0, 0.0
    for i in range(4):
        s, square = _on_edge(x, i, 2 if i < 2 else 0, 3 if i < 2 else 1)
        if square < best:
            best, end, share = square, i, s
    c[0] = c[1] = c[2] = c[3] = 0.0
    if end < 2:
        c[end], c[2], c[3] = 1.0, share - 1.0, -share
    else:
        c[end], c[0], c[1] = -1.0, 1.0 - share, share
    return best


@numba.njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _products(x, i, j, p, q, o):
    """Products a·a, a·b, b·b, r·a, r·b of a = x[j] − x[i], b = x[q] − x[p] and r = x[o] − x[p]."""
    aa = ab = bb = ra = rb = 0.0
    for k in range(3):
        a, b, r = x[j, k] - x[i, k], x[q, k] - x[p, k], x[o, k] - x[p, k]
        aa += a * a
        ab += a * b
        bb += b * b
        ra += r * a
        rb += r * b
    return aa, ab, bb, ra, rb


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _on_edge(x, p, i, j):
    """Share of the distance from x[i] to x[j] where x[p] is closest, and the squared distance."""
    along = up = 0.0
    for k in range(3):
        a = x[j, k] - x[i, k]
        along += a * a
        up += a * (x[p, k] - x[i, k])
    s = min(max(up / along, 0.0), 1.0) if along > 0.0 else 0.0
    square = 0.0
    for k in range(3):
        r = x[p, k] - x[i, k] - s * (x[j, k] - x[i, k])
        square += r * r
    return s, square


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _square(x, c):
    total = 0.0
    for k in range(3):
        r = c[0] * x[0, k] + c[1] * x[1, k] + c[2] * x[2, k] + c[3] * x[3, k]
        total += r * r
    return total


@numba.njit(cache=True, error_model="numpy", nogil=True)
def advance(x, p, is_corner, radius, kept, until, c, y):
    """Fraction of moves p (4, 3) of a pair x (4, 3) that leaves a share ``kept`` of its distance, at most ``until``.

    Conservative advancement (Li, Kaufman and Jiang 2021, section 5): the closest points of a pair approach no faster
    than its fastest points do, measured from their common motion. radius: taken off distances.
    c (4,), y (4, 3): memory.
    """
    mean = np.empty(3)
    for k in range(3):
        mean[k] = 0.25 * (p[0, k] + p[1, k] + p[2, k] + p[3, k])
    first = second = 0.0
    for i in range(4):
        square = 0.0
        for k in range(3):
            square += (p[i, k] - mean[k]) ** 2
        if i == 0 or (i == 1 and not is_corner):
            first = max(first, square)
        else:
            second = max(second, square)
    fastest = math.sqrt(first) + math.sqrt(second)
    distance = math.sqrt(closest_points(x, is_corner, c)) - radius
    if (1.0 - kept) * distance >= until * fastest:
        return until
    least, done = kept * distance, 0.0
    for _ in range(_MOST_ADVANCES):
        spare = distance - least
        done += spare / fastest
        if done >= until:
            return until
        if spare < 0.01 * least:
            break
        for i in range(4):
            for k in range(3):
                y[i, k] = x[i, k] + done * p[i, k]
        distance = math.sqrt(closest_points(y, is_corner, c)) - radius
        if distance <= least:
            break
    return done
