"""Compiled loops over the pairs of a surface contact: which are close, energy, forces, and the bound of a step.

All loops run over arrays of pairs: vertices (n, 4), of which the first ``corners`` pairs are of a vertex and a
triangle and the others of two edges.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from yarnscale.numerics.pair_distance import advance, closest_points


@numba.njit(cache=True, error_model="numpy", nogil=True)
def distances(positions, pairs, corners, begin, end):
    """Distances (end − begin,) of pairs begin … end − 1."""
    found, x, c = np.empty(end - begin), np.empty((4, 3)), np.empty(4)
    for n in range(begin, end):
        _gather(positions, pairs, n, x)
        found[n - begin] = math.sqrt(closest_points(x, n < corners, c))
    return found


@numba.njit(cache=True, error_model="numpy", nogil=True)
def pairs_within(positions, pairs, corners, gaps, moved, radius, within, begin, end):
    """Pairs begin … end − 1 nearer than ``within``: numbers (k,), coefficients (k, 4), distances (k,), normals (k, 3).

    gaps: their distances (n,) before vertices moved by lengths (nv,); radius: taken off their distances.
    """
    numbers, count = np.empty(end - begin, np.int64), 0
    coefficients, normals = np.empty((256, 4)), np.empty((256, 3))
    x, c, reach = np.empty((4, 3)), np.empty(4), within + radius
    for n in range(begin, end):
        is_corner = n < corners
        if gaps[n] - _both_sides(moved, pairs, n, is_corner) >= reach:
            continue
        if _gap(positions, pairs, n, is_corner) >= reach:
            continue
        _gather(positions, pairs, n, x)
        if closest_points(x, is_corner, c) >= reach * reach:
            continue
        if count == len(coefficients):
            coefficients = np.concatenate((coefficients, np.empty_like(coefficients)))
            normals = np.concatenate((normals, np.empty_like(normals)))
        for k in range(3):
            normals[count, k] = c[0] * x[0, k] + c[1] * x[1, k] + c[2] * x[2, k] + c[3] * x[3, k]
        numbers[count], coefficients[count] = n, c
        count += 1
    normals = normals[:count].copy()
    lengths = np.empty(count)
    for k in range(count):
        lengths[k] = math.sqrt(normals[k, 0] ** 2 + normals[k, 1] ** 2 + normals[k, 2] ** 2)
        normals[k] /= lengths[k]
    return numbers[:count].copy(), coefficients[:count].copy(), lengths - radius, normals


@numba.njit(cache=True, error_model="numpy", nogil=True)
def free_fraction(positions, step, pairs, corners, gaps, moved, travels, radius, kept, until, begin, end):
    """Fraction of a step, up to ``until``, in which pairs begin … end − 1 keep a share of their distances.

    gaps: their distances (n,) before vertices moved by lengths (nv,); travels: lengths of the step (nv,);
    radius: taken off distances.
    """
    fraction = until
    x, p, y, c = np.empty((4, 3)), np.empty((4, 3)), np.empty((4, 3)), np.empty(4)
    for n in range(begin, end):
        is_corner = n < corners
        fastest = fraction * _both_sides(travels, pairs, n, is_corner) / (1.0 - kept)
        if gaps[n] - _both_sides(moved, pairs, n, is_corner) - radius >= fastest:
            continue
        if _gap(positions, pairs, n, is_corner) - radius >= fastest:
            continue
        _gather(positions, pairs, n, x)
        _gather(step, pairs, n, p)
        fraction = min(fraction, advance(x, p, is_corner, radius, kept, fraction, c, y))
    return fraction


@numba.njit(cache=True, error_model="numpy", nogil=True, inline="always")
def _both_sides(lengths, pairs, n, is_corner):
    """Sum of the largest lengths (nv,) on the two sides of a pair."""
    a, b, c, d = lengths[pairs[n, 0]], lengths[pairs[n, 1]], lengths[pairs[n, 2]], lengths[pairs[n, 3]]
    return a + max(b, c, d) if is_corner else max(a, b) + max(c, d)


@numba.njit(cache=True, error_model="numpy", nogil=True)
def add_moments(positions, pairs, moments, gradient):
    """Add moments (n,) times ∇|a × b|² of pairs of edges (n, 4), a = x₁ − x₀ and b = x₃ − x₂."""
    x, a, b, u = np.empty((4, 3)), np.empty(3), np.empty(3), np.empty(3)
    first, second = np.empty(3), np.empty(3)
    for n in range(len(pairs)):
        if moments[n] == 0.0:
            continue
        _gather(positions, pairs, n, x)
        for k in range(3):
            a[k], b[k] = x[1, k] - x[0, k], x[3, k] - x[2, k]
        cross(a, b, u)
        cross(b, u, first)
        cross(u, a, second)
        for k in range(3):
            gradient[pairs[n, 0], k] -= 2.0 * moments[n] * first[k]
            gradient[pairs[n, 1], k] += 2.0 * moments[n] * first[k]
            gradient[pairs[n, 2], k] -= 2.0 * moments[n] * second[k]
            gradient[pairs[n, 3], k] += 2.0 * moments[n] * second[k]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def add_pulls(pairs, coefficients, pulls, gradient):
    """Add pulls (n, 3) on the closest points of pairs (n, 4) to the gradient."""
    for n in range(len(pairs)):
        for i in range(4):
            for k in range(3):
                gradient[pairs[n, i], k] += coefficients[n, i] * pulls[n, k]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def slips(positions, origin, pairs, coefficients, normals):
    """Motion of the closest points of pairs (n, 4) against each other from the origin, across the normals, (n, 3)."""
    sliding = np.empty((len(pairs), 3))
    for n in range(len(pairs)):
        along = 0.0
        for k in range(3):
            apart = 0.0
            for i in range(4):
                v = pairs[n, i]
                apart += coefficients[n, i] * (positions[v, k] - origin[v, k])
            sliding[n, k] = apart
            along += apart * normals[n, k]
        for k in range(3):
            sliding[n, k] -= along * normals[n, k]
    return sliding


@numba.njit(cache=True, error_model="numpy", nogil=True)
def crossed_squares(positions, pairs):
    """|(x₁ − x₀) × (x₃ − x₂)|² of pairs of edges (n, 4), (n,) [m⁴]."""
    squares = np.empty(len(pairs))
    a, b, u = np.empty(3), np.empty(3), np.empty(3)
    for n in range(len(pairs)):
        for k in range(3):
            a[k] = positions[pairs[n, 1], k] - positions[pairs[n, 0], k]
            b[k] = positions[pairs[n, 3], k] - positions[pairs[n, 2], k]
        cross(a, b, u)
        squares[n] = u[0] * u[0] + u[1] * u[1] + u[2] * u[2]
    return squares


@numba.njit(cache=True, error_model="numpy", nogil=True)
def cross(a, b, product):
    """Set product = a × b."""
    product[0] = a[1] * b[2] - a[2] * b[1]
    product[1] = a[2] * b[0] - a[0] * b[2]
    product[2] = a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _gather(rows, pairs, n, x):
    for i in range(4):
        v = pairs[n, i]
        for k in range(3):
            x[i, k] = rows[v, k]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _gap(positions, pairs, n, is_corner):
    """Largest distance along an axis between the boxes of the two sides of a pair: no more than their distance."""
    p, q, r, s = pairs[n, 0], pairs[n, 1], pairs[n, 2], pairs[n, 3]
    gap = 0.0
    for k in range(3):
        a, b, c, d = positions[p, k], positions[q, k], positions[r, k], positions[s, k]
        if is_corner:
            gap = max(gap, min(b, c, d) - a, a - max(b, c, d))
        else:
            gap = max(gap, min(c, d) - max(a, b), min(a, b) - max(c, d))
    return gap
