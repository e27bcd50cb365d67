"""How the energy of a cell changes with the parameters of its yarns and with its rest lengths, all else held.

What the stencils give, derivatives by their own parameters, is carried over to stiffnesses [N, N m², kg/s²] and from
there to the fields of a ``YarnMaterial`` and its rules (EST22 §6: k_s1, ε̄, k_b, R₁, k_c1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.cell.energy import CellEnergy
from yarnscale.yarn.material import YarnMaterial

PARAMETERS = ("young_modulus", "shear_modulus", "bending_scale", "contact_stiffness")
"""Numbers of a ``YarnMaterial`` that an equilibrium depends on."""
STIFFNESSES = ("stretch_stiffness", "bending_stiffness", "twist_stiffness")
"""k_s (k_s1) [N], k_b and k_t [N m²], each with the others held; see ``YarnMaterial.with_stiffnesses``."""
TWO_PHASE = ("stretch.knee", "stretch.stiff_modulus")
"""Parameters of two-phase stretch."""
BARRIERS = ("contact.outer_radius_ratio", "contact.inner_stiffness", "contact.inner_radius_ratio")
"""Parameters of the contact rule ``est2022``, which all materials share."""


@dataclass(frozen=True, eq=False)
class ExplicitPart:
    """∂W/∂p at a fixed free vector [E π r³ per unit of p].

    by_material: a dictionary for every material. shared: parameters that belong to none. by_length: (n,) per radius.
    """

    by_material: tuple[dict[str, float], ...]
    shared: dict[str, float]
    by_length: Array


def explicit_part(energy: CellEnergy, x: Array) -> ExplicitPart:
    """Derivatives of the energy at a fixed free vector, by every parameter that its materials have."""
    full = energy.nodes.expand(x)
    by_length = np.zeros(energy.count)
    stretch = _stretch(energy, full, by_length)
    joints = _joints(energy, full, by_length)
    contact, shared = _contact(energy, full, by_length)
    r = energy.pattern.radius
    by_material = tuple(
        _of_material(m, r, *values)
        for m, *values in zip(energy.stiffness.materials, stretch, joints, contact, strict=True)
    )
    return ExplicitPart(by_material, shared, by_length)


def _of_material(material: YarnMaterial, r: float, stretch: Array, joint: Array, contact: float) -> dict[str, float]:
    """Derivatives by one material's parameters from those by (k_s1, k_s2, ε̄), (k_b, k_t) and its k_contact."""
    section = math.pi * r**2
    two_phase = material.stretch.law == "two_phase"
    soft = stretch[0] if two_phase else stretch[0] + stretch[1]
    bend, twist = joint[0] * section * r**2 / 4.0, joint[1] * section * r**2 / 2.0
    found = {
        "young_modulus": soft * section + bend * material.bending_scale,
        "shear_modulus": twist * material.bending_scale,
        "bending_scale": bend * material.young_modulus + twist * material.shear_modulus,
        "contact_stiffness": contact,
        "stretch_stiffness": soft,
        "bending_stiffness": joint[0],
        "twist_stiffness": joint[1],
    }
    if two_phase:
        found |= {"stretch.knee": stretch[2], "stretch.stiff_modulus": stretch[1] * section}
    return {name: float(value) for name, value in found.items()}


def _summed(energy: CellEnergy, columns: Array, kind: Integers | None = None) -> Array:
    """Sums of (N, k) over the stencils of each material, (materials, k)."""
    kind = energy.stiffness.kind if kind is None else kind
    total = np.zeros((len(energy.stiffness.materials), columns.shape[1]))
    np.add.at(total, kind, columns)
    return total


def _stretch(energy: CellEnergy, full: Array, by_length: Array) -> Array:
    """Derivatives by (k_s1, k_s2, ε̄) of each material (materials, 3); adds those by rest lengths."""
    names = tuple(name for name in energy.rods.stretch.energy.parameters if name != "turns")
    found = energy.rods.stretch.by_parameters(full, names)
    by_length += found[:, 0]
    columns = np.zeros((energy.count, 3))
    columns[:, : found.shape[1] - 1] = found[:, 1:]
    force = energy.unit / energy.pattern.radius
    section = energy.pattern.relative_radius[:, None] ** [2.0, 2.0, 0.0]
    return _summed(energy, columns * section * [1.0 / force, 1.0 / force, 1.0])


def _joints(energy: CellEnergy, full: Array, by_length: Array) -> Array:
    """Derivatives by (k_b, k_t) of each material (materials, 2); adds those by rest lengths."""
    pattern = energy.pattern
    found = energy.rods.bend_twist.by_parameters(full, ("bend_stiffness", "twist_stiffness"))
    bend, twist = energy.stiffness.joint_stiffness()
    by_joint = -(found[:, 0] * bend + found[:, 1] * twist) * pattern.radius / pattern.voronoi_length
    by_length += 0.5 * by_joint
    np.add.at(by_length, pattern.previous_vertex, 0.5 * by_joint)
    scale = pattern.relative_radius**4 / (pattern.voronoi_length * energy.unit)
    return _summed(energy, found * scale[:, None])


def _contact(energy: CellEnergy, full: Array, by_length: Array) -> tuple[Array, dict[str, float]]:
    """Derivatives by each material's k_contact (materials,) and by ``BARRIERS``; adds those by rest lengths."""
    contacts, stiffness = energy.rods.contacts(full), energy.stiffness
    stencils, rule = contacts.stencils, stiffness.rule
    barriers = rule.kernel == "est2022"
    names = tuple(stencils.energy.parameters)
    found = np.zeros((stencils.count, len(names)))
    if stencils.count:
        found = stencils.by_parameters(full, names)
    edges = contacts.first, contacts.second % energy.count
    length = energy.pattern.rest_length / energy.pattern.radius
    pressed = (found * stencils.parameters)[:, ::2].sum(axis=1)
    for side in edges:
        np.add.at(by_length, side, pressed / length[side])

    # Of the harmonic mean k = 2 a b/(a + b), ∂k/∂a = ½ (k/a)²; stiffnesses of stencils are k times their measure.
    own = np.array([m.contact_stiffness for m in stiffness.materials])
    mean = stiffness.pair_stiffness(*edges)
    by_mean = found[:, 0] * stencils.parameters[:, 0] / mean
    by_contact = np.zeros(len(own))
    for side in edges:
        kind = stiffness.kind[side]
        np.add.at(by_contact, kind, 0.5 * by_mean * (mean / own[kind]) ** 2)
    if not barriers:
        return by_contact, {}
    inner = found[:, 2] * stencils.parameters[:, 2] / rule.inner_stiffness
    shared = (
        -2.0 * (found[:, 1] * stencils.parameters[:, 1]).sum() / rule.outer_radius_ratio,
        inner.sum(),
        -2.0 * (found[:, 3] * stencils.parameters[:, 3]).sum() / rule.inner_radius_ratio,
    )
    return by_contact, {name: float(value) for name, value in zip(BARRIERS, shared, strict=True)}
