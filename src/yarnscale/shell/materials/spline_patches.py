"""Spline terms laid out for evaluation: patches on shared knots, gathered by element.

A spline material is evaluated by one polynomial kernel; the patches of an element's
strains are parameters of that kernel. The rows of parameters are named here, and filled by the gather.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numba
import numpy as np

from yarnscale.arrays import Array
from yarnscale.numerics.kernel import LANES
from yarnscale.shell.materials.tables import (
    BicubicSpline,
    CubicSpline,
    find_interval,
    origins,
    padded_knots,
    union_knots,
)

AXES = ("s_x", "s_a", "s_y", "lambda_x", "lambda_y")
"""Names of the five strains the terms depend on, in the order of their indices."""
PLANES = ((0, 1), (0, 2), (1, 2), (0, 3), (1, 3), (2, 3), (0, 4), (1, 4), (2, 4))
"""Axes of the nine two-dimensional terms; there is no lambda_x–lambda_y term."""

# Rows of an element's parameters: origins of s_x, s_a, s_y; origin of q and knot of d for both families; a
# guard that keeps ρ away from zero where d = 0; three in-plane patches; for each family three patches of q
# and three of d.
ORIGIN_S, ORIGIN_X, ORIGIN_Y, GUARD, PLANE_ROWS, FAMILY_X, FAMILY_Y = 0, 3, 5, 7, 8, 56, 152
PARAMETER_COUNT = 248
# Below this fraction of the knots' span, eigenvalues count as equal (the difference to the exact function is
# of second order in it, and zero away from knots).
MEETING = 1e-8


class PackedSplines(NamedTuple):
    """Spline patches of a material on shared knots; ``knots`` are padded, ``origins`` are those of the
    intervals.

    Two-dimensional tables have shape (intervals, intervals, 16); one-dimensional terms are folded into them.
    """

    knots_x: Array
    knots_a: Array
    knots_y: Array
    knots_bend_x: Array
    knots_bend_y: Array
    origins_x: Array
    origins_a: Array
    origins_y: Array
    origins_bend_x: Array
    origins_bend_y: Array
    plane_xa: Array
    plane_xy: Array
    plane_ay: Array
    bend_xx: Array
    bend_ax: Array
    bend_yx: Array
    bend_xy: Array
    bend_ay: Array
    bend_yy: Array


def pack_splines(
    constant: float, axes: Sequence[CubicSpline], planes: Mapping[tuple[int, int], BicubicSpline]
) -> PackedSplines:
    """The terms of a material (see ``SplineMaterial``) on shared knots."""
    knots = []
    for axis in range(5):
        found = [axes[axis].knots]
        found += [term.knots_u for (u, _), term in planes.items() if u == axis]
        found += [term.knots_v for (_, v), term in planes.items() if v == axis]
        knots.append(union_knots(*found))
    single = [f.refined_table(k) for f, k in zip(axes, knots, strict=True)]
    tables = []
    for u, v in PLANES:
        term = planes.get((u, v))
        shape = (len(knots[u]) + 1, len(knots[v]) + 1, 4, 4)
        table = np.zeros(shape) if term is None else term.refined_table(knots[u], knots[v])
        if (u, v) == (0, 1):
            table[..., 0, 0] += constant
            table[..., :, 0] += single[0][:, None]
            table[..., 0, :] += single[1][None]
        elif (u, v) in ((0, 2), (0, 3), (0, 4)):
            table[..., 0, :] += single[v][None]
        tables.append(np.ascontiguousarray(table.reshape(*shape[:2], 16)))
    return PackedSplines._make((*(padded_knots(k) for k in knots), *(origins(k) for k in knots), *tables))


@numba.njit(cache=True, fastmath={"contract"}, error_model="numpy")
def gather_parameters(packed, forms, count, parameters):
    """Fill parameters (P, stride) for ``count`` columns of forms (6, stride); callable inside ``@njit``.

    Works on LANES elements at a time so that every row of ``parameters`` is written by whole cache lines.
    """
    place = np.empty((7, LANES), np.int64)  # intervals: s_x, s_a, s_y; of λ1 and λ2 on both bending axes
    for start in range(0, count, LANES):
        for lane in range(LANES):
            n = start + lane
            root_x, root_y = np.sqrt(forms[0, n]), np.sqrt(forms[2, n])
            place[0, lane] = find_interval(packed.knots_x, root_x - 1.0)
            place[1, lane] = find_interval(packed.knots_a, forms[1, n] / (root_x * root_y))
            place[2, lane] = find_interval(packed.knots_y, root_y - 1.0)
            middle, half = 0.5 * (forms[3, n] + forms[5, n]), 0.5 * (forms[3, n] - forms[5, n])
            radius = np.sqrt(half * half + forms[4, n] * forms[4, n])
            meet = radius < MEETING * (packed.origins_bend_x[-1] - packed.origins_bend_x[0])
            reach = 0.0 if meet else radius
            place[3, lane] = find_interval(packed.knots_bend_x, middle + reach)
            place[4, lane] = find_interval(packed.knots_bend_x, middle - reach)
            place[5, lane] = find_interval(packed.knots_bend_y, middle + reach)
            place[6, lane] = find_interval(packed.knots_bend_y, middle - reach)
            one_piece = place[3, lane] == place[4, lane] and place[5, lane] == place[6, lane]
            parameters[GUARD, n] = 1.0 if one_piece else 0.0
            parameters[ORIGIN_S, n] = packed.origins_x[place[0, lane]]
            parameters[ORIGIN_S + 1, n] = packed.origins_a[place[1, lane]]
            parameters[ORIGIN_S + 2, n] = packed.origins_y[place[2, lane]]
            parameters[ORIGIN_X, n] = packed.origins_bend_x[place[4, lane]]
            parameters[ORIGIN_X + 1, n] = packed.origins_bend_x[place[3, lane]]
            parameters[ORIGIN_Y, n] = packed.origins_bend_y[place[6, lane]]
            parameters[ORIGIN_Y + 1, n] = packed.origins_bend_y[place[5, lane]]
        _copy_patches(packed.plane_xa, place[0], place[1], parameters, PLANE_ROWS, start)
        _copy_patches(packed.plane_xy, place[0], place[2], parameters, PLANE_ROWS + 16, start)
        _copy_patches(packed.plane_ay, place[1], place[2], parameters, PLANE_ROWS + 32, start)
        family = (packed.bend_xx, packed.bend_ax, packed.bend_yx)
        _copy_family(family, place, 3, packed.origins_bend_x, parameters, FAMILY_X, start)
        family = (packed.bend_xy, packed.bend_ay, packed.bend_yy)
        _copy_family(family, place, 5, packed.origins_bend_y, parameters, FAMILY_Y, start)


@numba.njit(cache=True, inline="always")
def _copy_family(tables, place, axis, origin, parameters, row, start):
    _copy_patches(tables[0], place[0], place[axis + 1], parameters, row, start)
    _copy_patches(tables[1], place[1], place[axis + 1], parameters, row + 16, start)
    _copy_patches(tables[2], place[2], place[axis + 1], parameters, row + 32, start)
    upper, lower = place[axis], place[axis + 1]
    _copy_differences(tables[0], place[0], upper, lower, origin, parameters, row + 48, start)
    _copy_differences(tables[1], place[1], upper, lower, origin, parameters, row + 64, start)
    _copy_differences(tables[2], place[2], upper, lower, origin, parameters, row + 80, start)


@numba.njit(cache=True)
def _copy_patches(table, first, second, parameters, row, start):
    for lane in range(LANES):
        patch = table[first[lane], second[lane]]
        for k in range(16):
            parameters[row + k, start + lane] = patch[k]


@numba.njit(cache=True)
def _copy_differences(table, first, upper, lower, origin, parameters, row, start):
    """Patch of λ1 less patch of λ2, both about the left knot of λ1's interval."""
    for lane in range(LANES):
        n = start + lane
        if upper[lane] == lower[lane]:
            for k in range(16):
                parameters[row + k, n] = 0.0
            continue
        offset = origin[upper[lane]] - origin[lower[lane]]
        p, q = table[first[lane], upper[lane]], table[first[lane], lower[lane]]
        for k in range(0, 16, 4):
            parameters[row + k, n] = 0.0
            parameters[row + k + 1, n] = 0.0
            if upper[lane] > lower[lane] + 1:  # else values and slopes agree at the shared knot
                moved = q[k] + offset * (q[k + 1] + offset * (q[k + 2] + offset * q[k + 3]))
                parameters[row + k, n] = p[k] - moved
                moved = q[k + 1] + offset * (2.0 * q[k + 2] + 3.0 * offset * q[k + 3])
                parameters[row + k + 1, n] = p[k + 1] - moved
            parameters[row + k + 2, n] = p[k + 2] - (q[k + 2] + 3.0 * offset * q[k + 3])
            parameters[row + k + 3, n] = p[k + 3] - q[k + 3]
