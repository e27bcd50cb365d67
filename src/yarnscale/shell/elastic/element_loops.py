"""Loops over blocks of shell elements: gather, gradients, JᵀCJ, geometric terms and scatter.

Every block is a structure of arrays of BLOCK elements, component first: corners (18, B), jacobian (108, B),
moduli (21, B) as lower triangles row by row, element Hessians (171, B) likewise.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from yarnscale.numerics.address_call import call_address
from yarnscale.shell.elastic.moduli import FAST, full_moduli


@numba.njit(**FAST)
def forms_of_blocks(
    positions: NDArray, stencils: NDArray, geometry: NDArray, address: int, jacobian: NDArray, forms: NDArray
) -> None:
    """Forms (nb, 6, B) and, if ``jacobian`` (nb, 108, B) is not empty, their derivatives at positions (nv, 3).

    address: kernel (corners, geometry) → forms[, jacobian]; stencils: (nb, B, 6); geometry: (nb, 18, B).
    """
    lanes = stencils.shape[1]
    corners = np.empty((18, lanes))
    pointers = np.empty(4, np.int64)
    for b in range(stencils.shape[0]):
        gather_corners(positions, stencils[b], corners)
        pointers[0], pointers[1], pointers[2] = (corners.ctypes.data, geometry[b].ctypes.data, forms[b].ctypes.data)
        if len(jacobian):
            pointers[3] = jacobian[b].ctypes.data
        call_address(address, (lanes, lanes, pointers))


@numba.njit(**FAST)
def gradient_of_blocks(jacobian: NDArray, stress: NDArray, areas: NDArray, stencils: NDArray, out: NDArray) -> None:
    """Add Σ area·Jᵀ·stress to ``out`` (nv, 3); stress (nb, 6, B), areas (nb, B)."""
    lanes = stencils.shape[1]
    element = np.empty((18, lanes))
    for b in range(stencils.shape[0]):
        element_gradient(jacobian[b], stress[b], areas[b], element)
        scatter_gradient(element, stencils[b], out)


@numba.njit(**FAST)
def exact_hessian_of_blocks(
    positions: NDArray,
    stencils: NDArray,
    geometry: NDArray,
    areas: NDArray,
    jacobian: NDArray,
    stress: NDArray,
    moduli: NDArray,
    address: int,
    slots: NDArray,
    out: NDArray,
) -> None:
    """Add exact element Hessians to matrix entries ``out`` through slots (nb, B, 171).

    address: kernel (corners, geometry, stress) → Σ stress ∇² forms.
    """
    lanes = stencils.shape[1]
    corners, full = np.empty((18, lanes)), np.empty((36, lanes))
    work, element, term = np.empty((108, lanes)), np.empty((171, lanes)), np.empty((171, lanes))
    pointers = np.empty(4, np.int64)
    for b in range(stencils.shape[0]):
        full_moduli(moduli[b], full)
        element_hessian(jacobian[b], full, areas[b], work, element)
        gather_corners(positions, stencils[b], corners)
        pointers[0], pointers[1] = corners.ctypes.data, geometry[b].ctypes.data
        pointers[2], pointers[3] = stress[b].ctypes.data, term.ctypes.data
        call_address(address, (lanes, lanes, pointers))
        add_scaled(term, areas[b], element)
        scatter_hessian(element, slots[b], out)


@numba.njit(**FAST)
def add_positive_hessian(
    geometry: NDArray,
    areas: NDArray,
    jacobian: NDArray,
    stress: NDArray,
    positive: NDArray,
    slots: NDArray,
    out: NDArray,
) -> None:
    """Add the positive element Hessians of one block, from positive moduli (36, B), to matrix entries ``out``."""
    lanes = areas.shape[0]
    work, element = np.empty((108, lanes)), np.empty((171, lanes))
    element_hessian(jacobian, positive, areas, work, element)
    add_membrane_term(stress, geometry, areas, element)
    scatter_hessian(element, slots, out)


@numba.njit(**FAST)
def gather_corners(positions: NDArray, stencils: NDArray, out: NDArray) -> None:
    """Coordinates of the stencils (n, 6) into ``out`` (18, n)."""
    for n in range(stencils.shape[0]):
        for a in range(6):
            for c in range(3):
                out[3 * a + c, n] = positions[stencils[n, a], c]


@numba.njit(**FAST)
def element_gradient(jacobian: NDArray, stress: NDArray, areas: NDArray, out: NDArray) -> None:
    """Area·Jᵀ·stress into ``out`` (18, n)."""
    for i in range(18):
        for n in range(areas.shape[0]):
            total = 0.0
            for a in range(6):
                total += jacobian[18 * a + i, n] * stress[a, n]
            out[i, n] = areas[n] * total


@numba.njit(**FAST)
def element_hessian(jacobian: NDArray, moduli: NDArray, areas: NDArray, work: NDArray, out: NDArray) -> None:
    """Area·Jᵀ·C·J into ``out`` (171, n), with full moduli C (36, n) and work (108, n)."""
    for a in range(6):
        for i in range(18):
            for n in range(areas.shape[0]):
                work[18 * a + i, n] = areas[n] * (
                    moduli[6 * a, n] * jacobian[i, n]
                    + moduli[6 * a + 1, n] * jacobian[18 + i, n]
                    + moduli[6 * a + 2, n] * jacobian[36 + i, n]
                    + moduli[6 * a + 3, n] * jacobian[54 + i, n]
                    + moduli[6 * a + 4, n] * jacobian[72 + i, n]
                    + moduli[6 * a + 5, n] * jacobian[90 + i, n]
                )
    k = 0
    for i in range(18):
        for j in range(i + 1):
            for n in range(areas.shape[0]):
                out[k, n] = (
                    jacobian[i, n] * work[j, n]
                    + jacobian[18 + i, n] * work[18 + j, n]
                    + jacobian[36 + i, n] * work[36 + j, n]
                    + jacobian[54 + i, n] * work[54 + j, n]
                    + jacobian[72 + i, n] * work[72 + j, n]
                    + jacobian[90 + i, n] * work[90 + j, n]
                )
            k += 1


@numba.njit(**FAST)
def add_membrane_term(stress: NDArray, geometry: NDArray, areas: NDArray, out: NDArray) -> None:
    """Add the tensile part of Σ stress_k ∇² I_k to element Hessians (171, n): the 2×2 stress projected on tension."""
    slopes = np.empty((3, 2))
    corners = np.empty(3, np.int64)
    for n in range(areas.shape[0]):
        xx, xy, yy = 2.0 * stress[0, n], stress[1, n], 2.0 * stress[2, n]
        mean, half = 0.5 * (xx + yy), 0.5 * (xx - yy)
        radius = math.sqrt(half * half + xy * xy) + 1e-300
        high, low = max(mean + radius, 0.0), max(mean - radius, 0.0)
        spread = 0.5 * (high - low) / radius
        mean = 0.5 * (high + low)
        xx, xy, yy = mean + spread * half, spread * xy, mean - spread * half
        corners[0], corners[1], corners[2] = 0, 1, 2 if geometry[8, n] == 0.0 else 3
        for j in range(2):
            slopes[1, j], slopes[2, j] = geometry[4 + 2 * j, n], geometry[5 + 2 * j, n]
            slopes[0, j] = -slopes[1, j] - slopes[2, j]
        for p in range(3):
            for q in range(p + 1):
                entry = areas[n] * (
                    slopes[p, 0] * (xx * slopes[q, 0] + xy * slopes[q, 1])
                    + slopes[p, 1] * (xy * slopes[q, 0] + yy * slopes[q, 1])
                )
                for c in range(3):
                    i, j = 3 * corners[p] + c, 3 * corners[q] + c
                    out[i * (i + 1) // 2 + j, n] += entry


@numba.njit(**FAST)
def add_scaled(term: NDArray, areas: NDArray, out: NDArray) -> None:
    """Add area·term (171, n) to element Hessians."""
    for k in range(171):
        for n in range(areas.shape[0]):
            out[k, n] += areas[n] * term[k, n]


@numba.njit(**FAST)
def scatter_gradient(element: NDArray, stencils: NDArray, out: NDArray) -> None:
    """Add element gradients (18, n) to ``out`` (nv, 3)."""
    for n in range(stencils.shape[0]):
        for a in range(6):
            for c in range(3):
                out[stencils[n, a], c] += element[3 * a + c, n]


@numba.njit(**FAST)
def scatter_hessian(element: NDArray, slots: NDArray, out: NDArray) -> None:
    """Add element Hessians (171, n) to matrix entries through slots (n, 171), −1: of no interest."""
    for n in range(slots.shape[0]):
        for k in range(171):
            out[slots[n, k]] += element[k, n]
