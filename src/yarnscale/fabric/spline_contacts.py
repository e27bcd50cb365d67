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

from yarnscale.arrays import Array
from yarnscale.fabric.spline_knit import SplineFabric
from yarnscale.numerics.assembly import position_variables
from yarnscale.numerics.energy import StencilEnergy, Symbol
from yarnscale.numerics.kernel import Kernel, compile_kernel, run_columns


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
