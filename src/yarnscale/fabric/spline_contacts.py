"""Contacts between spline yarns as constraints of three scalars each (LOD03 §2).

The two points of a contact keep their distance and slide along neither yarn: |D|, D·t and D·s stay what they are at
rest, D from point to point, t and s the unit tangents. These do not see rigid motion, so that constraint forces exert
no torque. Constraints that fix D itself, or D turned with some frame that the forces do not act back on, make fabric
turn by itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
from scipy.sparse import csr_array

from yarnscale.arrays import Array, Integers
from yarnscale.fabric.spline_knit import SplineFabric
from yarnscale.numerics.assembly import position_variables, symmetric
from yarnscale.numerics.energy import StencilEnergy, Symbol
from yarnscale.numerics.kernel import Kernel, compile_kernel, run_columns

_STIFFNESS = 0.3
"""Stiffness of springs in place of constraints, over that of one radius of yarn; moduli then differ by 1 % from those
with a hundred times as stiff springs."""


def _kept(gap: Symbol, first: Symbol, second: Symbol) -> Symbol:
    """Distance and both slides, of the vector between both points and the derivatives of the curves there."""
    along = [ca.dot(gap, t) / ca.sqrt(ca.dot(t, t)) for t in (first, second)]
    return ca.vertcat(ca.sqrt(ca.dot(gap, gap)), *along)


def _spring(v: Mapping[str, Symbol], p: Mapping[str, Symbol]) -> Symbol:
    return 0.5 * p["stiffness"] * ca.sumsqr(_kept(v["gap"], v["first"], v["second"]) - p["rest"])


STITCH_SPRING = StencilEnergy(
    "stitch_spring", {"gap": 3, "first": 3, "second": 3}, {"rest": 3, "stiffness": 1}, _spring
)  # fmt: skip
"""½ k |v − v̄|² of the distance and both slides v of a contact [m]: a constraint where k [N/m] is large."""


def stitch_stiffness(fabric: SplineFabric) -> float:
    """Stiffness of ``StitchSprings`` of a fabric [N/m]."""
    return _STIFFNESS * fabric.material.stretch_stiffness(fabric.radius) / fabric.radius


class StitchSprings:
    """Springs in place of contacts, as a function of nodes (g, m, 3) [m]: the same contacts in each of g sets.

    nodes: (k, 8), of both points of every contact. ties: (k, 3, 8) to gap and tangents.
    """

    def __init__(self, nodes: Integers, weights: Array, slopes: Array, reference: Array, stiffness: Array) -> None:
        """nodes, weights, slopes: (k, 2, 4) that give both points and their derivatives by the curve parameter.

        reference: nodes at rest (m, 3) [m]; stiffness: of every set (g,) [N/m].
        """
        one, other, zero = *np.moveaxis(slopes, 1, 0), np.zeros((len(nodes), 4))
        rows = [[weights[:, 0], -weights[:, 1]], [one, zero], [zero, other]]
        self.ties = np.stack([np.concatenate(row, axis=1) for row in rows], axis=1)
        self.nodes = nodes.reshape(-1, 8)
        rest = np.einsum("kij,kjc->ikc", self.ties, reference[self.nodes])
        values, _ = kept_values(*rest)
        self._springs = np.column_stack([np.tile(values, (len(stiffness), 1)), np.repeat(stiffness, len(values))])

    def value(self, nodes: Array) -> float:
        """Energy [J]."""
        return float(run_columns(STITCH_SPRING.value, self._stretched(nodes), self._springs)[0].sum())

    def gradient(self, nodes: Array, force: Array) -> float:
        """Energy [J]; adds the gradient (g, m, 3) [N]."""
        energies, pulls = run_columns(STITCH_SPRING.gradient, self._stretched(nodes), self._springs)
        shares = np.einsum("kij,gkic->kjgc", self.ties, pulls.reshape(len(nodes), -1, 3, 3))
        np.add.at(force.transpose(1, 0, 2), self.nodes, shares)
        return float(energies.sum())

    def hessians(self, nodes: Array) -> Array:
        """Hessians by gap and tangents (g·k, 9, 9) [N/m]."""
        return symmetric(run_columns(STITCH_SPRING.hessian, self._stretched(nodes), self._springs)[2], 9)

    def _stretched(self, nodes: Array) -> Array:
        """Gap and both tangents of every contact (g·k, 9)."""
        return np.einsum("kij,gkjc->gkic", self.ties, nodes[:, self.nodes]).reshape(-1, 9)


@cache
def _kernel() -> Kernel:
    gap, first, second = (ca.SX.sym(name, 3) for name in ("gap", "first", "second"))
    values = _kept(gap, first, second)
    slopes = ca.vec(ca.densify(ca.jacobian(values, ca.vertcat(gap, first, second))).T)
    return compile_kernel(ca.Function("contact", [gap, first, second], [values, slopes], {"cse": True}), "contact")


@dataclass(frozen=True, eq=False)
class SplineContacts:
    """The contacts of a fabric; ``rest`` (k, 3): distance and both slides [m] that they keep."""

    fabric: SplineFabric
    rest: Array

    @classmethod
    def of(cls, fabric: SplineFabric) -> SplineContacts:
        """Contacts as they are in the fabric's rest shape."""
        return cls(fabric, _measured(fabric, fabric.control.reshape(-1, 3))[0])

    def linearised(self, control: Array) -> tuple[csr_array, Array]:
        """Derivatives of the constraints by control points (3k, 3n), and how far they are from kept (3k,) [m].

        control: (n, 3) [m]. The rows have one sparsity, whatever the state.
        """
        fabric = self.fabric
        values, slopes = _measured(fabric, control)
        by_gap, by_first, by_second = (slopes[:, :, 3 * k : 3 * k + 3] for k in range(3))
        blocks, nodes = [], []
        for points, sign, by_tangent in ((fabric.first, 1.0, by_first), (fabric.second, -1.0, by_second)):
            index, weights = fabric.rows(points)
            _, changes = fabric.rows(points, 1)
            blocks.append(
                sign * np.einsum("kij,kn->kinj", by_gap, weights) + np.einsum("kij,kn->kinj", by_tangent, changes)
            )
            nodes.append(index)
        index = np.concatenate(nodes, axis=1)
        columns = np.repeat(position_variables(index)[:, None], 3, axis=1)
        count = 3 * len(index)
        begin = np.arange(count + 1) * columns.shape[2]
        data = np.concatenate(blocks, axis=2).reshape(-1)
        matrix = csr_array((data, columns.reshape(-1), begin), shape=(count, control.size))
        matrix.sum_duplicates()
        return matrix, (values - self.rest).ravel()


def _measured(fabric: SplineFabric, control: Array) -> tuple[Array, Array]:
    """Distance and slides of every contact (k, 3), and their derivatives by gap and tangents (k, 3, 9)."""
    gap = fabric.at(control, fabric.first) - fabric.at(control, fabric.second)
    return kept_values(gap, fabric.at(control, fabric.first, 1), fabric.at(control, fabric.second, 1))


def kept_values(gap: Array, first: Array, second: Array) -> tuple[Array, Array]:
    """What contacts keep (k, 3) [m], of vectors between both points and tangents there (k, 3); by these (k, 3, 9)."""
    if not len(gap):
        return np.empty((0, 3)), np.empty((0, 3, 9))
    values, slopes = run_columns(_kernel(), gap, first, second)
    return values, slopes.reshape(-1, 3, 9)
