"""Friction of yarns on each other: Coulomb's law, smoothed, with the pressures of the step before (lagged)."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from yarnscale.numerics.assembly import StencilSet
from yarnscale.numerics.energy import StencilEnergy, Symbol

Array = NDArray[np.float64]


def _rub(v: dict[str, Symbol], p: dict[str, Symbol]) -> Symbol:
    s, t = p["place"][0], p["place"][1]
    slip = (1 - s) * v["a0"] + s * v["a1"] - (1 - t) * v["b0"] - t * v["b1"] - p["offset"]
    across = slip - p["normal"] * ca.dot(p["normal"], slip)
    return p["grip"] * (ca.sqrt(ca.dot(across, across) + p["smooth"] ** 2) - p["smooth"])


FRICTION = StencilEnergy(
    "yarn_friction",
    {"a0": 3, "a1": 3, "b0": 3, "b1": 3},
    {"place": 2, "offset": 3, "normal": 3, "grip": 1, "smooth": 1},
    _rub,  # type: ignore[arg-type]
)
"""μ N (√(|u|² + h²) − h): u the slip across the pressure since the step began; ``grip`` μ N, ``smooth`` h."""


@dataclass(frozen=True)
class YarnFriction:
    """Coefficient of friction μ [-], and the slip h [radii] within which a yarn sticks without sliding."""

    coefficient: float
    slip: float = 0.02

    def stencils(self, positions: Array, contacts: StencilSet, x: Array) -> StencilSet:
        """Friction of the pairs that press on each other at a state; positions (n, 3), contact stencils."""
        if contacts.count == 0 or self.coefficient == 0.0:
            return no_friction()
        force = contacts.elements(x)[1].reshape(-1, 4, 3)
        push = force[:, 0] + force[:, 1]
        size = np.linalg.norm(push, axis=1)
        kept = np.flatnonzero(size > 1e-9 * max(float(size.max(initial=0.0)), 1e-300))
        variables = contacts.variables[kept]
        ends = positions[variables[:, ::3] // 3]
        force, push, size = force[kept], push[kept], size[kept]
        # Where the pressure acts on either segment: shares of its two ends.
        normal = push / size[:, None]
        place = np.stack(
            [np.einsum("nj,nj->n", force[:, k], sign * normal) / size for k, sign in ((1, 1.0), (3, -1.0))], 1
        )
        place = np.clip(place, 0.0, 1.0)
        s, t = place[:, :1], place[:, 1:]
        offset = (1 - s) * ends[:, 0] + s * ends[:, 1] - (1 - t) * ends[:, 2] - t * ends[:, 3]
        smooth = np.full(len(kept), self.slip)
        parameters = np.column_stack([place, offset, normal, self.coefficient * size, smooth])
        return StencilSet(FRICTION, variables, parameters, 4)


def no_friction() -> StencilSet:
    """Stencils of nothing."""
    return StencilSet(FRICTION, np.empty((0, 12), np.int64), np.empty((0, FRICTION.parameter_count)), 4)
