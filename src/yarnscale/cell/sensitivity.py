"""How an equilibrium answers to small changes: of the macroscopic state, of the material, of the rest lengths.

At an equilibrium, ∇W = Cᵀλ and C x = 0. Energy changes by the explicit part alone (envelope theorem); stress changes
with the response dx/dz of the equilibrium to the state, which the six solves of ``moduli`` give for all parameters at
once: dΨ/dp = (W,p − λᵀ C,p x)/A, and d(∂Ψ/∂z)/dp is its derivative by z along the equilibria (theory §2). C,p is there
because rest lengths weigh the constraints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from yarnscale.cell.energy import CellEnergy, constraint_rows, vertex_tangents
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.implicit import ConstrainedInverse
from yarnscale.numerics.threads import on_one_thread

if TYPE_CHECKING:
    from yarnscale.cell.periodic import Equilibrium, PeriodicCell

Array = NDArray[np.float64]

PARAMETERS = ("young_modulus", "shear_modulus", "bending_scale", "contact_stiffness")
"""Numbers of a ``YarnMaterial`` that an equilibrium depends on."""
_STEP = 1e-5  # of central differences in the six components, times 1/r for curvature


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Derivatives of an equilibrium's energy density Ψ and stress by the parameters of its cell.

    energy: dΨ/dp of each of ``PARAMETERS`` [J/m² per unit of the parameter]; stress: d(stress)/dp, (6,) each.
    energy_by_rest_length: (n,) [J/m³]. stress_by_rest_length: (6, n), in the units of stress per metre.
    """

    energy: dict[str, float]
    stress: dict[str, Array]
    energy_by_rest_length: Array
    stress_by_rest_length: Array


@dataclass(frozen=True, eq=False)
class Response:
    """How an equilibrium x follows the macroscopic state z = (s_x, s_a, s_y, II11, II12, II22).

    x: (4n,). by_state: dx/dz (4n, 6). force_by_state: ∂(∇W)/∂z + H dx/dz (4n, 6), carried by the constraints.
    moduli: d²Ψ/dz² (6, 6). Lengths are in radii and energies in E π r³ but for the moduli.
    """

    energy: CellEnergy
    x: Array
    by_state: Array
    force_by_state: Array
    moduli: Array


def response(cell: PeriodicCell, state: Equilibrium) -> Response:
    """One solve per component with one factorisation; holds at flat, bent and doubly curved states.

    The explicit parts W,zz and W,xz are central differences of exact gradients at fixed x.
    """
    energy = cell.energy(state.strain)
    x = energy.start(state.fluctuation / cell.pattern.radius, state.twist)
    _, _, model = energy.quadratic(x)
    mixed, explicit = np.empty((len(x), 6)), np.empty((6, 6))
    for k, step in enumerate(_steps(cell)):
        sides = []
        for sign in (1.0, -1.0):
            moved = _moved(cell, state, k, sign * step)
            sides.append((moved.gradient(x)[1], moved.stress(x)))
        mixed[:, k] = (sides[0][0] - sides[1][0]) / (2 * step)
        explicit[k] = (sides[0][1] - sides[1][1]) / (2 * step)
    by_state = -ConstrainedInverse(model, energy.constraints, backend=cell.backend).apply(mixed)
    exact = model.values(0.0)
    carried = mixed + np.column_stack([model.pattern.multiply(exact, column) for column in by_state.T])
    moduli = explicit + energy.unit / cell.pattern.area * mixed.T @ by_state
    return Response(energy, x, by_state, carried, 0.5 * (moduli + moduli.T))


@on_one_thread
def sensitivities(cell: PeriodicCell, state: Equilibrium) -> Sensitivities:
    """Derivatives of energy density and stress by material parameters and rest lengths, at an equilibrium.

    The pattern's vertices, reference frames and integrated rest curvatures and twists are held.
    """
    answer = response(cell, state)
    energy, x, area = answer.energy, answer.x, cell.pattern.area
    rows = constraint_rows(cell.pattern, cell.sliding)
    forces = np.column_stack([energy.gradient(x)[1], answer.force_by_state])
    multipliers = np.asarray(np.linalg.lstsq(rows.T, forces, rcond=1e-12)[0], np.float64)
    length = slice(len(PARAMETERS), None)

    value = _explicit(cell, energy, x)
    value[length] -= _constraint_work(cell, multipliers[:, 0], x)
    stress = np.empty((6, len(value)))
    for k, step in enumerate(_steps(cell)):
        ahead, behind = (
            _explicit(cell, _moved(cell, state, k, s * step), x + s * step * answer.by_state[:, k])
            for s in (1.0, -1.0)
        )
        stress[k] = (ahead - behind) / (2 * step)
        stress[k, length] -= _constraint_work(cell, multipliers[:, 1 + k], x)
        stress[k, length] -= _constraint_work(cell, multipliers[:, 0], answer.by_state[:, k])
    value, stress = value * energy.unit / area, stress * energy.unit / area
    return Sensitivities(
        energy={name: float(value[k]) for k, name in enumerate(PARAMETERS)},
        stress={name: stress[:, k].copy() for k, name in enumerate(PARAMETERS)},
        energy_by_rest_length=value[length] / cell.pattern.radius,
        stress_by_rest_length=stress[:, length] / cell.pattern.radius,
    )


def _steps(cell: PeriodicCell) -> Array:
    return _STEP * np.array([1.0] * 3 + [1.0 / cell.pattern.radius] * 3)


def _moved(cell: PeriodicCell, state: Equilibrium, component: int, step: float) -> CellEnergy:
    """The energy a step away in one component; a step from a flat state may bend it both ways."""
    vector = state.strain.vector.copy()
    vector[component] += step
    return CellEnergy(cell.pattern, cell.material, ShellStrain.from_vector(vector), cell.sliding, True)


def _explicit(cell: PeriodicCell, energy: CellEnergy, x: Array) -> Array:
    """∂W/∂p at fixed x, (4 + n,): by the parameters and by the rest lengths [r], W in E π r³."""
    pattern, material, r = cell.pattern, cell.material, cell.pattern.radius
    full = energy.nodes.expand(x)
    length, joint = pattern.rest_length / r, pattern.voronoi_length / r
    by_length = energy.stretch.by_parameters(full, ("rest_length",))[:, 0].copy()

    by_bend, by_twist = energy.bend_twist.by_parameters(full, ("bend_stiffness", "twist_stiffness")).T
    joint_unit = pattern.voronoi_length * energy.unit
    bend, twist = material.bending_stiffness(r) / joint_unit, material.twist_stiffness(r) / joint_unit
    by_joint = -(by_bend * bend + by_twist * twist) / joint
    by_length += 0.5 * by_joint
    np.add.at(by_length, pattern.previous_vertex, 0.5 * by_joint)

    contacts = energy.contacts(x, full)
    names = ("stiffness",) if material.contact.kernel == "hylc2020" else ("stiffness", "inner_stiffness")
    stencils = contacts.stencils
    columns = [stencils.energy.parameter_rows(name).start for name in names]
    pressed = np.zeros((contacts.first.size, len(names)))
    if contacts.first.size:
        pressed = stencils.by_parameters(full, names) * stencils.parameters[:, columns]
    for side in (contacts.first, contacts.second % energy.count):
        np.add.at(by_length, side, pressed.sum(axis=1) / length[side])

    one = replace(material, bending_scale=1.0), replace(material, shear_modulus=1.0)
    by_material = np.array(
        [
            (energy.stretch.value(full) + by_bend @ bend) / material.young_modulus,
            by_twist @ (one[1].twist_stiffness(r) / joint_unit),
            (by_bend * one[0].bending_stiffness(r) + by_twist * one[0].twist_stiffness(r)) @ (1 / joint_unit),
            pressed[:, 0].sum() / material.contact_stiffness,
        ]
    )
    return np.concatenate([by_material, by_length])


def _constraint_work(cell: PeriodicCell, multipliers: Array, x: Array) -> Array:
    """λᵀ C,l x for each rest length l [r], (n,); C as ``constraint_rows`` gives it."""
    pattern, n = cell.pattern, len(cell.pattern.edges)
    moves, twist = x[: 3 * n].reshape(n, 3), x[3 * n :]
    tangents = vertex_tangents(pattern)
    at_vertex, at_edge = moves @ multipliers[:3], np.zeros(n)
    row = 3
    for yarn in pattern.yarns:
        at_edge[yarn] = multipliers[row] * twist[yarn]
        row += 1
        if not cell.sliding:
            at_vertex[yarn] += multipliers[row] * (tangents * moves).sum(axis=1)[yarn]
            row += 1
    # A vertex weighs half of its two edges.
    return at_edge + 0.5 * (at_vertex + at_vertex[pattern.next_vertex])
