"""Contact energy of two yarn segments: the published penalties with their quadrature."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from yarnscale.numerics.energy import LinearTerms, StencilEnergy, Symbol
from yarnscale.yarn.frames import GAUSS_POINTS
from yarnscale.yarn.material import ContactRule

BESIDE = 0.06
"""Distance of the places of contact from the Gauss points [edges]: at twice as much, chords touch as if thicker."""
_POINTS = {"a0": 3, "a1": 3, "b0": 3, "b1": 3}


class Sample(NamedTuple):
    """A place on a segment, from 0 to 1, its weight, and the share of the reach within which it counts."""

    place: float
    weight: float
    reach: float = 1.0


def contact_samples(rule: ContactRule, *, polyline: bool) -> tuple[Sample, ...]:
    """Quadrature along a segment: the rule's on polylines, on smooth yarns about Gauss's places with the same sum.

    Two places on either side of each make the energy smooth where yarns slide along each other. They are too far apart
    to hold yarns that come very close: half as near as they touch, the middle counts too.
    """
    weights = rule.quadrature_weights
    if polyline:
        return tuple(map(Sample, rule.quadrature_points, weights))
    total = sum(weights)
    places = (gauss + side for gauss in GAUSS_POINTS for side in (-BESIDE, BESIDE))
    return (*(Sample(place, 0.25 * total) for place in places), Sample(0.5, 0.5 * total, 0.5))


def _hylc2020(p: dict[str, Symbol]) -> Callable[[Symbol], Symbol]:
    """f(d) = 1/d² + d² − 2 for d = D/2r < 1, written as max(0, 1 − y)²/y with y = d² (HYLC20, after Kaldor 2008)."""

    def penalty(offset: Symbol) -> Symbol:
        y = ca.dot(offset, offset) * p["inverse_reach_squared"]
        return p["stiffness"] * ca.fmax(0, 1 - y) ** 2 / y

    return penalty


def _est2022(p: dict[str, Symbol]) -> Callable[[Symbol], Symbol]:
    """Two barriers k_i f(min(D/2R_i, 1)²) with f(x) = −(x − 1)² ln x (EST22 eq. 7)."""

    def barrier(y: Symbol) -> Symbol:
        x = ca.fmin(y, 1)
        return -((x - 1) ** 2) * ca.log(x)

    def penalty(offset: Symbol) -> Symbol:
        square = ca.dot(offset, offset)
        outer = p["stiffness"] * barrier(square * p["inverse_reach_squared"])
        return outer + p["inner_stiffness"] * barrier(square * p["inner_inverse_reach_squared"])

    return penalty


_KERNELS = {
    "hylc2020": (_hylc2020, {"stiffness": 1, "inverse_reach_squared": 1}),
    "est2022": (
        _est2022,
        {"stiffness": 1, "inverse_reach_squared": 1, "inner_stiffness": 1, "inner_inverse_reach_squared": 1},
    ),
}


@lru_cache
def contact_energy(kernel: str, samples: tuple[Sample, ...]) -> StencilEnergy:
    """Contact energy of two segments (a0, a1), (b0, b1): Σ_ij w_i w_j penalty(distance at (s_i, t_j)).

    kernel: ``hylc2020`` or ``est2022``. samples: along each segment; of two, the smaller share of the reach counts.
    Parameters of a pair: ``stiffness`` k l_a l_b [J], ``inverse_reach_squared`` 1/(2r)² [1/m²] (and the inner pair).
    """
    build, parameters = _KERNELS[kernel]
    eye, zero = np.eye(3), np.zeros((3, 3))
    to_offsets = np.block([[eye, zero, -eye, zero], [-eye, eye, zero, zero], [zero, zero, -eye, eye]])

    def energy(v: dict[str, Symbol], p: dict[str, Symbol]) -> LinearTerms:
        penalty = build(p)

        def along_second(first: Sample, second: Sample) -> tuple[ca.DM, Callable[[Symbol], Symbol]]:
            matrix = np.block([eye, -second.place * eye])
            weight, share = first.weight * second.weight, min(first.reach, second.reach)
            return ca.sparsify(ca.DM(matrix)), lambda u: weight * penalty(u / share)

        def along_first(first: Sample) -> tuple[ca.DM, Callable[[Symbol], LinearTerms]]:
            matrix = ca.sparsify(ca.DM(np.block([[eye, first.place * eye, zero], [zero, zero, eye]])))
            inner = [along_second(first, second) for second in samples]
            return matrix, lambda _: LinearTerms(inner)

        outer = [along_first(first) for first in samples]
        return LinearTerms([(ca.sparsify(ca.DM(to_offsets)), lambda _: LinearTerms(outer))])

    return StencilEnergy(f"contact_{kernel}_{len(samples)}", _POINTS, parameters, energy)  # type: ignore[arg-type]


def contact_reach(rule: ContactRule) -> float:
    """Distance of centre lines below which two yarns are in contact [r]."""
    if rule.kernel == "est2022":
        return 2.0 * max(rule.outer_radius_ratio, rule.inner_radius_ratio)
    return 2.0
