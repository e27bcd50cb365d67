"""Intersections of segments whose ends move along straight lines.

Two segments pass through each other where the volume of the tetrahedron of their four ends, a cubic in time, changes
its sign while they meet; the sign of the change is the side.
"""

from __future__ import annotations

import numba
import numpy as np

_JIT = {"cache": True, "error_model": "numpy"}
_MEETING = 1e-8
"""Squared distance, over squared lengths of the segments, below which coplanar segments meet."""


@numba.njit(**_JIT)
def _triple(u, v, w):
    return (
        u[0] * (v[1] * w[2] - v[2] * w[1])
        + u[1] * (v[2] * w[0] - v[0] * w[2])
        + u[2] * (v[0] * w[1] - v[1] * w[0])
    )


@numba.njit(**_JIT)
def _cubic(k, t):
    return ((k[3] * t + k[2]) * t + k[1]) * t + k[0]


@numba.njit(**_JIT)
def pair_cuts(before, after, ends, first, second):
    """Cuts of pairs of segments (k → ends[k]) between two sets of nodes (n, 3), (m, 6).

    Columns: segments of the pair, time, places on both segments in [0, 1), sign of the change of the volume.
    """
    out = np.empty((64, 6))
    found = 0
    k, split = np.empty(4), np.empty(4)
    for m in range(first.shape[0]):
        i, g = first[m], second[m]
        e, f = ends[i], ends[g]
        if i == g or e == g or f == i:
            continue
        # Volume u·(v × w) of the edges u, w and the vector v between them, each linear in time.
        u0, w0, v0 = before[e] - before[i], before[f] - before[g], before[g] - before[i]
        u1, w1, v1 = after[e] - after[i] - u0, after[f] - after[g] - w0, after[g] - after[i] - v0
        k[0] = _triple(u0, v0, w0)
        k[1] = _triple(u1, v0, w0) + _triple(u0, v1, w0) + _triple(u0, v0, w1)
        k[2] = _triple(u1, v1, w0) + _triple(u1, v0, w1) + _triple(u0, v1, w1)
        k[3] = _triple(u1, v1, w1)
        b1, b2, b3 = k[0] + k[1] / 3, k[0] + (2 * k[1] + k[2]) / 3, k[0] + k[1] + k[2] + k[3]
        if min(k[0], b1, b2, b3) > 0.0 or max(k[0], b1, b2, b3) < 0.0:
            continue  # Bernstein coefficients of one sign: no root
        parts = _monotone_parts(k, split)
        for part in range(parts):
            left, right = split[part], split[part + 1]
            start, stop = _cubic(k, left), _cubic(k, right)
            if (start > 0.0) == (stop > 0.0):
                continue
            sign = 1.0 if stop > 0.0 else -1.0
            for _ in range(52):
                middle = 0.5 * (left + right)
                if (_cubic(k, middle) > 0.0) == (start > 0.0):
                    left = middle
                else:
                    right = middle
            t = 0.5 * (left + right)
            u, v, w = u0 + t * u1, v0 + t * v1, w0 + t * w1
            uu, uw, ww = np.sum(u * u), np.sum(u * w), np.sum(w * w)
            uv, vw = np.sum(u * v), np.sum(v * w)
            skew = uu * ww - uw * uw
            if skew <= 1e-24 * uu * ww:
                continue
            s, r = (uv * ww - uw * vw) / skew, (uw * uv - uu * vw) / skew
            if 0.0 <= s < 1.0 and 0.0 <= r < 1.0:
                gap = s * u - v - r * w
                if np.sum(gap * gap) > _MEETING * (
                    uu + ww
                ):  # side by side: coplanar all the time, but for round-off
                    continue
                if found == out.shape[0]:
                    out = np.concatenate((out, np.empty((found, 6))))
                out[found] = np.array([i, g, t, s, r, sign])
                found += 1
    return out[:found]


@numba.njit(**_JIT)
def _monotone_parts(k, split):
    """Ends of the intervals of [0, 1] in which the cubic is monotone; their number."""
    split[0] = 0.0
    count = 1
    a, b, c = 3 * k[3], 2 * k[2], k[1]
    root = b * b - 4 * a * c
    if root > 0.0:
        q = -0.5 * (b + (np.sqrt(root) if b >= 0 else -np.sqrt(root)))
        first = q / a if a != 0.0 else -1.0
        second = c / q if q != 0.0 else -1.0
        for value in (min(first, second), max(first, second)):
            if 0.0 < value < 1.0:
                split[count] = value
                count += 1
    split[count] = 1.0
    return count
