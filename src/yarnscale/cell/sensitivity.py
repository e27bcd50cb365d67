"""How an equilibrium answers to small changes: of the macroscopic state, of the material, of the rest lengths.

At an equilibrium, ∇W = Cᵀλ and C x = 0. Energy changes by the explicit part alone (envelope theorem); stress changes
with the response dx/dz of the equilibrium to the state, which the six solves of ``moduli`` give for all parameters at
once: dΨ/dp = (W,p − λᵀ C,p x)/A, and d(∂Ψ/∂z)/dp is its derivative by z along the equilibria (theory §2). C,p is there
because rest lengths weigh the constraints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from yarnscale.arrays import Array
from yarnscale.cell.constraints import constraint_rows, vertex_tangents
from yarnscale.cell.energy import CellEnergy
from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.cell.parameters import ExplicitPart, explicit_part
from yarnscale.numerics.implicit import ConstrainedInverse
from yarnscale.numerics.threads import on_one_thread

_STEP = 1e-5  # of central differences in the six components, times 1/r for curvature
_SMALL_STEP = 2e-8  # of one-sided ones: contacts that begin between the two ends of a longer one spoil it


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Derivatives of an equilibrium's energy density Ψ and stress by the parameters of its cell.

    energy: dΨ/dp [J/m² per unit of the parameter], by name: ``PARAMETERS`` and ``STIFFNESSES``, ``TWO_PHASE`` where a
    material has that law, ``BARRIERS`` where contact is ``est2022``; of several materials, as their parameters change
    alike. stress: d(stress)/dp, (6,) each. energy_of, stress_of: those of each material alone, without ``BARRIERS``.
    energy_by_rest_length: (n,) [J/m³]. stress_by_rest_length: (6, n), in the units of stress per metre.
    moduli: (6, 6), as ``PeriodicCell.moduli`` gives them.
    """

    energy: dict[str, float]
    stress: dict[str, Array]
    energy_of: tuple[dict[str, float], ...]
    stress_of: tuple[dict[str, Array], ...]
    energy_by_rest_length: Array
    stress_by_rest_length: Array
    moduli: Array


@dataclass(frozen=True, eq=False)
class Response:
    """How an equilibrium x follows the macroscopic state z = (s_x, s_a, s_y, II11, II12, II22).

    x: (4n,). by_state: dx/dz (4n, 6). force_by_state: ∂(∇W)/∂z + H dx/dz (4n, 6), carried by the constraints.
    moduli: d²Ψ/dz² (6, 6). Lengths are in radii and energies in E π r³ but for the moduli.
    """

    x: Array
    by_state: Array
    force_by_state: Array
    moduli: Array


def response(energy: CellEnergy, state: Equilibrium) -> Response:
    """One solve per component with one factorisation; holds at flat, bent and doubly curved states.

    energy: of which the state is an equilibrium.
    W,xz is a one-sided difference of exact gradients at fixed x, as is that part of W,zz in which forces change.
    """
    x = energy.start(state.fluctuation / energy.pattern.radius, state.twist)
    _, gradient, model = energy.quadratic(x)
    steps, both = _SMALL_STEP / _STEP * _steps(energy), _symmetric(energy)
    moved = [both.moved(k, step) for k, step in enumerate(steps)]
    mixed = np.column_stack([(m.gradient(x)[1] - gradient) / h for m, h in zip(moved, steps, strict=True)])
    explicit = energy.unit / energy.pattern.area * both.second(x, moved, steps)
    by_state = -ConstrainedInverse(model, energy.constraints).apply(mixed)
    exact = model.values(0.0)
    carried = mixed + np.column_stack([model.pattern.multiply(exact, column) for column in by_state.T])
    moduli = explicit + energy.unit / energy.pattern.area * mixed.T @ by_state
    return Response(x, by_state, carried, 0.5 * (moduli + moduli.T))


@on_one_thread
def sensitivities(energy: CellEnergy, state: Equilibrium) -> Sensitivities:
    """Derivatives of energy density and stress by material parameters and rest lengths, at an equilibrium of an energy.

    The pattern's vertices, reference frames and integrated rest curvatures and twists are held.
    """
    answer, pattern = response(energy, state), energy.pattern
    x, unit, r = answer.x, energy.unit / pattern.area, pattern.radius
    rows = constraint_rows(pattern, energy.sliding)
    forces = np.column_stack([energy.gradient(x)[1], answer.force_by_state])
    size = np.sqrt(rows.multiply(rows).sum(axis=1))[:, None]
    unit_rows = csr_array(rows / size)
    inverse = np.linalg.pinv((unit_rows @ unit_rows.T).toarray(), rcond=1e-12, hermitian=True)
    multipliers = inverse @ (unit_rows @ forces) / size

    here = explicit_part(energy, x)
    value = _flat(here)
    lengths = slice(len(value) - energy.count, None)
    value[lengths] -= _constraint_work(energy, multipliers[:, 0], x)
    stress, both = np.empty((6, len(value))), _symmetric(energy)
    for k, step in enumerate(_steps(energy)):
        ahead, behind = (
            _flat(explicit_part(both.moved(k, s * step), x + s * step * answer.by_state[:, k])) for s in (1.0, -1.0)
        )
        stress[k] = (ahead - behind) / (2 * step)
        stress[k, lengths] -= _constraint_work(energy, multipliers[:, 1 + k], x)
        stress[k, lengths] -= _constraint_work(energy, multipliers[:, 0], answer.by_state[:, k])
    value, stress = value * unit, stress * unit
    energy_of, energy_shared = _named(here, value)
    stress_of, stress_shared = _named(here, stress.T)
    return Sensitivities(
        energy={name: float(total) for name, total in _together(energy_of, energy_shared).items()},
        stress=_together(stress_of, stress_shared),
        energy_of=tuple({name: float(v) for name, v in entry.items()} for entry in energy_of),
        stress_of=stress_of,
        energy_by_rest_length=value[lengths] / r,
        stress_by_rest_length=stress[:, lengths] / r,
        moduli=answer.moduli,
    )


def _flat(part: ExplicitPart) -> Array:
    """All derivatives in a row: of the materials, shared, by rest lengths."""
    named = [value for entry in (*part.by_material, part.shared) for value in entry.values()]
    return np.concatenate([named, part.by_length])


def _named(part: ExplicitPart, rows: Array) -> tuple[tuple[dict[str, Array], ...], dict[str, Array]]:
    """Rows in the order of ``_flat`` by name: of each material, and shared."""
    entries = iter(rows)
    *own, shared = ({name: next(entries).copy() for name in e} for e in (*part.by_material, part.shared))
    return tuple(own), shared


def _together(own: tuple[dict[str, Array], ...], shared: dict[str, Array]) -> dict[str, Array]:
    """Derivatives as all materials change alike."""
    total = dict(shared)
    for entry in own:
        for name, value in entry.items():
            total[name] = total[name] + value if name in total else value
    return total


def _steps(energy: CellEnergy) -> Array:
    return _STEP * np.array([1.0] * 3 + [1.0 / energy.pattern.radius] * 3)


def _symmetric(energy: CellEnergy) -> CellEnergy:
    """The same energy, which may bend."""
    return energy if energy.symmetric else replace(energy, symmetric=True)


def _constraint_work(energy: CellEnergy, multipliers: Array, x: Array) -> Array:
    """λᵀ C,l x for each rest length l [r], (n,); C as ``constraint_rows`` gives it."""
    pattern, n = energy.pattern, len(energy.pattern.edges)
    moves, twist = x[: 3 * n].reshape(n, 3), x[3 * n :]
    tangents = vertex_tangents(pattern)
    at_vertex, at_edge = moves @ multipliers[:3], np.zeros(n)
    row = 3
    for yarn in pattern.yarns:
        at_edge[yarn] = multipliers[row] * twist[yarn]
        row += 1
        if not energy.sliding:
            at_vertex[yarn] += multipliers[row] * (tangents * moves).sum(axis=1)[yarn]
            row += 1
    # A vertex weighs half of its two edges.
    return at_edge + 0.5 * (at_vertex + at_vertex[pattern.next_vertex])
