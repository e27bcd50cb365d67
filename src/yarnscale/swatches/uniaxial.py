"""A shell material pulled along one direction and free across, in closed form but for one unknown (EST22 eq. 3).

F = U diag(1 + s, 1 − c) Uᵀ with U the turn of the direction: the contraction c minimises the energy density, and
the stress along is σ = dψ/ds, the first Piola–Kirchhoff stress. There is no shear in these axes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from yarnscale.arrays import Array
from yarnscale.shell.materials.material import LOWER, ShellMaterial
from yarnscale.shell.materials.orthotropic import ConstantTerm, DirectionalMaterial

_ACROSS = np.linspace(0.1, 1.6, 76)
"""Lengths across among which the start is chosen."""
_ITERATIONS = 30


def uniaxial(material: ShellMaterial, angle: float, stretches: Array) -> tuple[Array, Array]:
    """Stress along [N/m] and contraction c at stretches (n,) along an angle from the course direction [rad]."""
    along = 1.0 + np.asarray(stretches, np.float64)
    across = _start(material, angle, along)
    for _ in range(_ITERATIONS):
        _, gradient, hessian = _derivatives(material, angle, along, across)
        curvature = hessian[:, 1, 1]
        # Where the energy is not convex, downhill by a tenth.
        step = np.where(curvature > 0, -gradient[:, 1] / np.maximum(curvature, 1e-300), -0.1 * np.sign(gradient[:, 1]))
        step = np.clip(step, -0.2 * across, 0.2 * across)
        across = across + step
        if np.abs(step).max(initial=0.0) < 1e-13:
            break
    _, gradient, _ = _derivatives(material, angle, along, across)
    return gradient[:, 0], 1.0 - across


def uniaxial_sensitivity(
    material: DirectionalMaterial, angle: float, stretches: Array, constants: Sequence[str]
) -> tuple[Array, Array, Array, Array]:
    """Stress [N/m] and contraction as ``uniaxial``, (n,), and their derivatives by constants, both (n, constants).

    c stays the minimum: dc/dp = −ψ,cp / ψ,cc, and dσ/dp = ψ,sp + ψ,sc dc/dp.
    """
    stretches = np.asarray(stretches, np.float64)
    stress, contraction = uniaxial(material, angle, stretches)
    along, across = 1.0 + stretches, 1.0 - contraction
    _, _, hessian = _derivatives(material, angle, along, across)
    by_stress, by_contraction = np.empty((2, len(stretches), len(constants)))
    for k, name in enumerate(constants):
        _, mixed, _ = _derivatives(ConstantTerm(material, name), angle, along, across)
        wider = -mixed[:, 1] / np.maximum(hessian[:, 1, 1], 1e-300)
        by_stress[:, k], by_contraction[:, k] = mixed[:, 0] + hessian[:, 0, 1] * wider, -wider
    return stress, contraction, by_stress, by_contraction


def biaxial_stress(material: ShellMaterial, stretches: Array) -> Array:
    """First Piola–Kirchhoff stress [N/m] along weft and warp at stretches of both, (n, 2) each."""
    along, across = 1.0 + np.asarray(stretches, np.float64).T
    return _derivatives(material, 0.0, along, across)[1]


def biaxial_sensitivity(material: DirectionalMaterial, stretches: Array, constants: Sequence[str]) -> Array:
    """Derivatives of ``biaxial_stress`` by constants, (n, 2, constants)."""
    return np.stack([biaxial_stress(ConstantTerm(material, name), stretches) for name in constants], axis=-1)


def _start(material: ShellMaterial, angle: float, along: Array) -> Array:
    """The best of many lengths across, for every stretch."""
    pairs = np.repeat(along, len(_ACROSS)), np.tile(_ACROSS, len(along))
    energy, _, _ = _derivatives(material, angle, *pairs)
    return _ACROSS[np.argmin(energy.reshape(len(along), -1), axis=1)]


def _derivatives(material: ShellMaterial, angle: float, along: Array, across: Array) -> tuple[Array, Array, Array]:
    """ψ (n,) and its derivatives by the lengths along and across, (n, 2) and (n, 2, 2)."""
    c, s = math.cos(angle), math.sin(angle)
    # I = along² u uᵀ + across² v vᵀ, by the entries I11, I12, I22.
    of_along, of_across = np.array([c * c, c * s, s * s]), np.array([s * s, -c * s, c * c])
    first = np.outer(along**2, of_along) + np.outer(across**2, of_across)
    strains = np.zeros((len(first), 6))
    strains[:, 0], strains[:, 2] = np.sqrt(first[:, 0]) - 1, np.sqrt(first[:, 2]) - 1
    strains[:, 1] = first[:, 1] / np.sqrt(first[:, 0] * first[:, 2])
    energy, gradient, lower = material.form_derivatives(strains)
    second = np.empty((len(first), 3, 3))
    for k, (i, j) in enumerate(LOWER[:6]):
        second[:, i, j] = second[:, j, i] = lower[k]
    basis = np.stack([of_along, of_across])
    slope = gradient[:3].T @ basis.T
    lengths = np.column_stack([along, across])
    hessian = 4 * np.einsum("ai,nij,bj->nab", basis, second, basis) * lengths[:, :, None] * lengths[:, None, :]
    hessian[:, [0, 1], [0, 1]] += 2 * slope
    return energy, 2 * lengths * slope, hessian
