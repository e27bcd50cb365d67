"""Second derivatives of the contact of pairs, positive and in closed form, and their sum in a sparse matrix.

The distance d of the closest points Σ c x, whose coefficients change along g_a as the points slide on their
triangle or edges, has ∇d = c n. With orthonormalised t_a = Σ g_a x and correspondingly changed g_a,

    −d ∇²d = Σ_a [(c t_a)(d g_a n)ᵀ + (d g_a n)(c t_a)ᵀ + (d g_a n)(d g_a n)ᵀ] − Σ_p (c p)(c p)ᵀ

with p normal to n and all t_a. Repulsion has b' < 0, so −b'/d times this is added to b'' (c n)(c n)ᵀ.
With t_a rotated so that the g_a are orthogonal, the sum consists of 2×2 blocks [[0, α], [α, β]],
whose positive parts have rank one; the last term is negative and left out.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from yarnscale.shell.contact.pair_loops import cross


@numba.njit(cache=True, error_model="numpy", nogil=True)
def positive_terms(x, c, is_corner, slope, bend, turning, turned, vectors, sizes):
    """Vectors v (k, 4, 3) and sizes s (k,) with Hessian ≈ Σ s v vᵀ of one pair x (4, 3); their number k, up to 6.

    slope, bend: first and second derivative of its energy by the distance; turning, turned: those by the squared
    cross product of its edges.
    """
    r, t, g = np.empty(3), np.zeros((2, 3)), np.zeros((2, 4))
    square = 0.0
    for k in range(3):
        r[k] = c[0] * x[0, k] + c[1] * x[1, k] + c[2] * x[2, k] + c[3] * x[3, k]
        square += r[k] * r[k]
    d = math.sqrt(square)
    count = 0
    if bend > 0.0:
        sizes[0] = bend
        for i in range(4):
            for k in range(3):
                vectors[0, i, k] = c[i] * r[k] / d
        count = 1
    if slope < 0.0:
        long = math.sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2] + c[3] * c[3])
        for a in range(_slides(x, c, is_corner, t, g)):
            turn = math.sqrt(g[a, 0] ** 2 + g[a, 1] ** 2 + g[a, 2] ** 2 + g[a, 3] ** 2)
            if turn == 0.0:
                continue
            alpha, beta = long * turn * d, (turn * d) ** 2
            large = 0.5 * (beta + math.sqrt(beta * beta + 4.0 * alpha * alpha))
            norm = math.sqrt(alpha * alpha + large * large)
            sizes[count] = -slope / d * large
            along, across = alpha / (norm * long), large / (norm * turn * d)
            for i in range(4):
                for k in range(3):
                    vectors[count, i, k] = along * c[i] * t[a, k] + across * g[a, i] * r[k]
            count += 1
    if turning > 0.0:
        count = _twist(x, turning, turned, vectors, sizes, count)
    return count


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _slides(x, c, is_corner, t, g):
    """Set orthonormal directions t (2, 3) and changes g (2, 4), normal to each other, of coefficients; their number."""
    count = 0
    if is_corner:
        first = -1
        for i in range(1, 4):
            if c[i] == 0.0:
                continue
            if first < 0:
                first = i
            else:
                g[count, first], g[count, i] = 1.0, -1.0
                count += 1
    else:
        if c[0] != 0.0 and c[1] != 0.0:
            g[count, 0], g[count, 1] = -1.0, 1.0
            count += 1
        if c[2] != 0.0 and c[3] != 0.0:
            g[count, 2], g[count, 3] = 1.0, -1.0
            count += 1
    for a in range(count):
        for k in range(3):
            t[a, k] = g[a, 0] * x[0, k] + g[a, 1] * x[1, k] + g[a, 2] * x[2, k] + g[a, 3] * x[3, k]
        if a == 1:
            share = t[1, 0] * t[0, 0] + t[1, 1] * t[0, 1] + t[1, 2] * t[0, 2]
            for k in range(3):
                t[1, k] -= share * t[0, k]
            for i in range(4):
                g[1, i] -= share * g[0, i]
        length = math.sqrt(t[a, 0] ** 2 + t[a, 1] ** 2 + t[a, 2] ** 2)
        if length == 0.0:
            return a
        for k in range(3):
            t[a, k] /= length
        for i in range(4):
            g[a, i] /= length
    if count == 2:
        both = one = two = 0.0
        for i in range(4):
            both += g[0, i] * g[1, i]
            one += g[0, i] * g[0, i]
            two += g[1, i] * g[1, i]
        angle = 0.5 * math.atan2(2.0 * both, one - two)
        cosine, sine = math.cos(angle), math.sin(angle)
        for k in range(3):
            p, q = t[0, k], t[1, k]
            t[0, k], t[1, k] = cosine * p + sine * q, cosine * q - sine * p
        for i in range(4):
            p, q = g[0, i], g[1, i]
            g[0, i], g[1, i] = cosine * p + sine * q, cosine * q - sine * p
    return count


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _twist(x, turning, turned, vectors, sizes, count):
    """Add the terms by u = (x₁ − x₀) × (x₃ − x₂): 2·turning across u, and 2·turning + 4·turned·|u|² along it."""
    a, b, u = x[1] - x[0], x[3] - x[2], np.empty(3)
    cross(a, b, u)
    square = u[0] * u[0] + u[1] * u[1] + u[2] * u[2]
    frame = np.zeros((3, 3))
    if square > 0.0:
        for k in range(3):
            frame[0, k] = u[k] / math.sqrt(square)
    else:
        frame[0, 0] = 1.0
    least = 0
    for k in range(1, 3):
        if abs(frame[0, k]) < abs(frame[0, least]):
            least = k
    axis = np.zeros(3)
    axis[least] = 1.0
    cross(frame[0], axis, frame[1])
    frame[1] /= math.sqrt(frame[1, 0] ** 2 + frame[1, 1] ** 2 + frame[1, 2] ** 2)
    cross(frame[0], frame[1], frame[2])
    first, second = np.empty(3), np.empty(3)
    for row in range(3):
        size = 2.0 * turning + (4.0 * turned * square if row == 0 else 0.0)
        if size <= 0.0:
            continue
        cross(b, frame[row], first)
        cross(frame[row], a, second)
        sizes[count] = size
        for k in range(3):
            vectors[count, 0, k], vectors[count, 1, k] = -first[k], first[k]
            vectors[count, 2, k], vectors[count, 3, k] = -second[k], second[k]
        count += 1
    return count


@numba.njit(cache=True, error_model="numpy", nogil=True)
def add_repulsion(positions, pairs, corner, coefficients, slopes, bends, turning, turned, slots, blocks):
    """Add the Hessians of pairs (n, 4) to blocks (m, 9) at slots (n, 10), −1: of fixed vertices."""
    x, vectors, sizes = np.empty((4, 3)), np.empty((6, 4, 3)), np.empty(6)
    for n in range(len(pairs)):
        for i in range(4):
            for k in range(3):
                x[i, k] = positions[pairs[n, i], k]
        count = positive_terms(
            x, coefficients[n], corner[n], slopes[n], bends[n], turning[n], turned[n], vectors, sizes
        )
        for term in range(count):
            place = 0
            for i in range(4):
                for j in range(i + 1):
                    slot = slots[n, place]
                    place += 1
                    if slot < 0:
                        continue
                    p, q = (i, j) if pairs[n, i] >= pairs[n, j] else (j, i)
                    for row in range(3):
                        scaled = sizes[term] * vectors[term, p, row]
                        for column in range(3):
                            blocks[slot, 3 * row + column] += scaled * vectors[term, q, column]


@numba.njit(cache=True, error_model="numpy", nogil=True)
def add_friction(pairs, coefficients, normals, sliding, across, along, slots, blocks):
    """Add c cᵀ ⊗ K of pairs (n, 4) to blocks (m, 9): K has ``along`` along the slip and ``across`` normal to it."""
    stiffness = np.empty((3, 3))
    for n in range(len(pairs)):
        square = sliding[n, 0] ** 2 + sliding[n, 1] ** 2 + sliding[n, 2] ** 2
        more = (along[n] - across[n]) / square if square > 0.0 else 0.0
        for row in range(3):
            for column in range(3):
                stiffness[row, column] = (
                    more * sliding[n, row] * sliding[n, column] - across[n] * normals[n, row] * normals[n, column]
                )
            stiffness[row, row] += across[n]
        place = 0
        for i in range(4):
            for j in range(i + 1):
                slot = slots[n, place]
                place += 1
                if slot < 0:
                    continue
                factor = coefficients[n, i] * coefficients[n, j]
                for row in range(3):
                    for column in range(3):
                        blocks[slot, 3 * row + column] += factor * stiffness[row, column]
