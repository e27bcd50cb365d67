"""Friction of yarns on each other: Coulomb's law with the pressures of the beginning of a step (lagged).

Steps of equilibria and implicit ones minimise the potential of a spring and a slider. Explicit ones are far too short
for that: within them slip is stopped by impulses up to μ N Δt a pair, one pair after the other (as Moreau and Jean 1992
do), which takes energy away whatever the step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numba
import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.errors import not_negative
from yarnscale.numerics.assembly import StencilSet
from yarnscale.numerics.energy import Steadied, StencilEnergy, Symbol
from yarnscale.numerics.kernel import run_columns

_SWEEPS = 10
"""Rounds over all pairs that rub in an explicit step."""


def _rubbing(share: float) -> Callable[[dict[str, Symbol], dict[str, Symbol]], Steadied]:
    def rub(v: dict[str, Symbol], p: dict[str, Symbol]) -> Steadied:
        s, t = p["place"][0], p["place"][1]
        slip = (1 - s) * v["a0"] + s * v["a1"] - (1 - t) * v["b0"] - t * v["b1"] - p["offset"]
        across = slip - p["normal"] * ca.dot(p["normal"], slip)

        def work(square: Symbol) -> Symbol:
            most, limit = p["smooth"], p["smooth"] ** 2
            return p["force"] * (0.5 * ca.fmin(square, limit) / most + ca.sqrt(ca.fmax(square, limit)) - most)

        return Steadied(ca.dot(across, across), work, share)

    return rub


_POINTS = {"a0": 3, "a1": 3, "b0": 3, "b1": 3}
_PAIR = {"place": 2, "offset": 3, "normal": 3, "force": 1, "smooth": 1}
FRICTION = StencilEnergy("yarn_friction", _POINTS, _PAIR, _rubbing(0.0))  # type: ignore[arg-type]
"""Spring and slider: μ N |u|²/2h where |u| < h, μ N (|u| − h/2) beyond; ``force`` μ N, ``smooth`` h.

u is the slip across the pressure since ``offset``. It is the least, over the slid way p, of ½ k |u − p|² + μ N |p| with
k = μ N/h, and the force is never more than μ N.
"""
STEADY_FRICTION = StencilEnergy("steady_yarn_friction", _POINTS, _PAIR, _rubbing(0.6))  # type: ignore[arg-type]
"""The same with a Hessian for steps of whole fabrics, in which many pairs begin to slide or turn back at once."""


@dataclass(frozen=True, eq=False)
class Rubbing:
    """Pairs of segments that press on each other: their stencil variables (k, 12) and vertices (k, 4), where on either
    segment they do (k, 2), in shares of it, the direction (k, 3) in which the first is pushed, and how hard (k,).

    stiffness: (k,) 8 Σ k/R² over the penalties of a pair, R their reach: of ``hylc2020`` its second derivative where
    segments begin to touch, of ``est2022``, which begins softly, that at some 0.8 of the reach.
    """

    variables: Integers
    place: Array
    normal: Array
    pressure: Array
    stiffness: Array

    @classmethod
    def of(cls, contacts: StencilSet, x: Array) -> Rubbing:
        """The pairs of contact stencils that press at a state."""
        if contacts.count == 0:
            return cls(np.empty((0, 12), np.int64), np.empty((0, 2)), np.empty((0, 3)), np.empty(0), np.empty(0))
        columns = run_columns(contacts.energy.gradient, x[contacts.variables], contacts.parameters)
        force = columns[1].reshape(-1, 4, 3)
        push = force[:, 0] + force[:, 1]
        size = np.linalg.norm(push, axis=1)
        kept = np.flatnonzero(size > 1e-9 * max(float(size.max(initial=0.0)), 1e-300))
        force, push, size = force[kept], push[kept], size[kept]
        # Where the pressure acts on either segment: shares of its two ends.
        normal = push / size[:, None]
        place = np.stack(
            [np.einsum("nj,nj->n", force[:, k], sign * normal) / size for k, sign in ((1, 1.0), (3, -1.0))], 1
        )
        parameters = contacts.parameters[kept]  # of each penalty k and 1/R²
        stiffness = 8.0 * (parameters[:, ::2] * parameters[:, 1::2]).sum(axis=1)
        return cls(contacts.variables[kept], np.clip(place, 0.0, 1.0), normal, size, stiffness)

    @property
    def nodes(self) -> Integers:
        """Vertices, of the first segment and of the second."""
        return self.variables[:, ::3] // 3

    @property
    def weights(self) -> Array:
        """Of the four vertices (k, 4): the slip is that of the first place against the second."""
        s, t = self.place.T
        return np.stack([1.0 - s, s, t - 1.0, -t], axis=1)


@dataclass(frozen=True)
class YarnFriction:
    """Coefficient of friction μ [-].

    Contacts of cells and in implicit steps stick by springs as stiff as contact (``FrictionPairs``); in explicit steps
    they do not slip at all below the force μ N.
    """

    coefficient: float

    def __post_init__(self) -> None:
        not_negative("friction of yarns", self.coefficient, "zero or more")

    def slowed(self, velocity: Array, yielding: Array, contacts: StencilSet, x: Array, duration: float) -> Array:
        """Velocities (n, 3) after the friction of an explicit step [s] whose pressures are those at a state.

        yielding: (n,) one over the mass of every vertex, 0 for those that are led.
        """
        pairs, slower = Rubbing.of(contacts, x), np.ascontiguousarray(velocity).copy()
        most = self.coefficient * duration * pairs.pressure
        _stop_slip(slower, yielding, pairs.nodes, pairs.weights, pairs.normal, most, _SWEEPS)
        return slower


@numba.njit(cache=True, error_model="numpy")
def _stop_slip(velocity, yielding, nodes, weights, normal, most, sweeps):
    """Impulses across the pressures that stop the slip of each pair, no larger than ``most`` (k,); in place."""
    given = np.zeros((nodes.shape[0], 3))
    slip, change = np.empty(3), np.empty(3)
    for _ in range(sweeps):
        for p in range(nodes.shape[0]):
            yields = 0.0
            slip[:] = 0.0
            for j in range(4):
                node, weight = nodes[p, j], weights[p, j]
                yields += weight * weight * yielding[node]
                for c in range(3):
                    slip[c] += weight * velocity[node, c]
            if yields == 0.0:
                continue
            along = slip[0] * normal[p, 0] + slip[1] * normal[p, 1] + slip[2] * normal[p, 2]
            size = 0.0
            for c in range(3):
                change[c] = given[p, c] - (slip[c] - along * normal[p, c]) / yields
                size += change[c] ** 2
            share = min(1.0, most[p] / max(np.sqrt(size), 1e-300))
            for c in range(3):
                wanted = share * change[c]
                change[c] = wanted - given[p, c]
                given[p, c] = wanted
            for j in range(4):
                for c in range(3):
                    velocity[nodes[p, j], c] += weights[p, j] * yielding[nodes[p, j]] * change[c]
