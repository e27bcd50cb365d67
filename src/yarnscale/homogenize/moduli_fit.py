"""Second derivatives of energy as observations of stage 2: the moduli of the samples' equilibria.

Energies and stresses of states that lie far apart leave the curvature of a fit between them open. Where a knit is a
hundred times stiffer along one direction of (s_x, s_y) than along another, splines then come out indefinite where the
cell is stable. The moduli of a cell, six solves with a factor that is there, say what they are.

So that it is the definiteness that is matched, not the large entries, residuals are those of L⁻¹ (H − H_seen) L⁻ᵀ with
L Lᵀ = |H_seen| + D: magnitudes of eigenvalues, and D a share of the median of each diagonal entry.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from yarnscale.homogenize.observations import IN_STRESS, Observations

Array = NDArray[np.float64]
Orders = tuple[int, int, int, int, int]

NOISE = 0.01
"""Modulus, as a fraction of the median of its component, below which residuals stop being relative."""
_SAME = 1e-9
"""Curvatures closer than this fraction of the sampled range are equal."""


def orders_of(i: int, j: int) -> Orders:
    """Orders of ∂²/∂i∂j among five strains."""
    return tuple(int(k == i) + int(k == j) for k in range(5))  # type: ignore[return-value]


def known_moduli(data: Observations) -> NDArray[np.int64]:
    """States whose moduli are known."""
    return np.flatnonzero(np.isfinite(data.moduli).all(axis=(1, 2)))


def whitening(moduli: Array, strains: list[int]) -> Array:
    """L⁻¹ of the entries of some strains, (n, k, k)."""
    places = [IN_STRESS[k] for k in strains]
    block = moduli[:, places][:, :, places]
    size = np.median(np.abs(np.einsum("nii->ni", block)), axis=0) + 1e-300
    # Eigenvalues are taken in units of these sizes.
    unit = np.sqrt(size)
    values, vectors = np.linalg.eigh(block / unit[:, None] / unit)
    return vectors.transpose(0, 2, 1) / np.sqrt(np.abs(values) + NOISE)[:, :, None] / unit


def by_twist(strains: Array, family: int, value: Callable[[Array, int], Array]) -> Array:
    """∂²/∂II12² of one bending family of states (n, 5), whose second form is diagonal.

    family: 0 for x, 1 for y. value(states, order): F or a derivative ∂F/∂λ of the family at states (n, 5) that bend
    about its own axis alone. Second-order perturbation of [F(II)]₁₁ is the divided difference 2 F[λ, λ, μ] with the
    eigenvalues λ of the family's axis and μ of the other one.
    """
    own, other = strains[:, 3 + family], strains[:, 4 - family]
    states = strains.copy()
    states[:, 4 - family] = 0.0
    result = value(states, 2)
    gap = own - other
    apart = np.abs(gap) > _SAME * max(float(np.max(np.abs(strains[:, 3:]), initial=0.0)), 1e-300)
    if np.any(apart):
        here, there = states[apart], states[apart]
        there[:, 3 + family] = other[apart]
        gap = gap[apart].reshape(-1, *[1] * (result.ndim - 1))
        chord = (value(here, 0) - value(there, 0)) / gap
        result[apart] = 2.0 * (value(here, 1) - chord) / gap
    return result
