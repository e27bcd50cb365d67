"""Stretch, bending and twist of a yarn as a discrete elastic rod (theory §1; HYLC20 §5.1, EST22 eq. 5).

Frames are anchored: every edge has a fixed tangent and director (those of its rest shape, moved to the macroscopic
state), and the reference frame of an edge is the anchor transported to its present tangent. The energy is then a
function of the state alone and independent of its history.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import casadi as ca

from yarnscale.arrays import Array
from yarnscale.numerics.energy import StencilEnergy, Symbol
from yarnscale.numerics.kernel import Kernel, compile_kernel, run_columns
from yarnscale.yarn.frames import curve_share


def _cross(a: Symbol, b: Symbol) -> Symbol:
    return ca.vertcat(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _transport(vector: Symbol, start: Symbol, end: Symbol) -> Symbol:
    """Parallel transport from unit tangent ``start`` to ``end``: the least rotation between them."""
    cosine, axis = ca.dot(start, end), _cross(start, end)
    return vector * cosine + _cross(axis, vector) + axis * (ca.dot(axis, vector) / (1 + cosine))


def _rotated(vector: Symbol, axis: Symbol, angle: Symbol) -> Symbol:
    """A vector perpendicular to the unit ``axis``, turned about it."""
    return ca.cos(angle) * vector + ca.sin(angle) * _cross(axis, vector)


def _unit(vector: Symbol) -> Symbol:
    return vector / ca.sqrt(ca.dot(vector, vector))


def _strain(v: Mapping[str, Symbol], p: Mapping[str, Symbol]) -> Symbol:
    """Of the smooth curve that runs through the Gauss points of the edges: ``curve_share`` at both joints counts."""
    edge = v["x1"] - v["x0"]
    along = _unit(edge)
    turned = [ca.sumsqr(along - _unit(way)) for way in (v["x0"] - v["before"], v["after"] - v["x1"])]
    share = 0.5 * (curve_share(p["turns"][0] * turned[0]) + curve_share(p["turns"][1] * turned[1]))
    return ca.sqrt(ca.dot(edge, edge)) * share / p["rest_length"] - 1


def _stretch(v: Mapping[str, Symbol], p: Mapping[str, Symbol]) -> Symbol:
    return 0.5 * p["stiffness"] * p["rest_length"] * _strain(v, p) ** 2


def _two_phase_stretch(v: Mapping[str, Symbol], p: Mapping[str, Symbol]) -> Symbol:
    strain = _strain(v, p)
    knee, soft, stiff = p["knee"], p["stiffness"], p["stiff"]
    pressed, drawn = ca.fmin(strain, 0), ca.fmax(strain - knee, 0)
    middle = ca.fmin(ca.fmax(strain, 0), knee)
    density = stiff * pressed**2 + soft * middle**2 + stiff * drawn**2 + 2 * soft * knee * drawn
    return 0.5 * p["rest_length"] * density


def _bend_twist(v: Mapping[str, Symbol], p: Mapping[str, Symbol]) -> Symbol:
    before, after = _unit(v["x1"] - v["x0"]), _unit(v["x2"] - v["x1"])
    reference_before = _transport(p["director0"], p["tangent0"], before)
    reference_after = _transport(p["director1"], p["tangent1"], after)
    # Angle about the outgoing tangent from the carried-over frame to the frame there, on the branch of its rest value.
    carried = _rotated(_transport(reference_before, before, after), after, p["reference_twist"])
    deviation = ca.atan2(
        ca.dot(after, _cross(carried, reference_after)), ca.dot(carried, reference_after)
    )  # fmt: skip
    twist = v["theta1"] - v["theta0"] + p["reference_twist"] + deviation

    binormal = 2 * _cross(before, after) / (1 + ca.dot(before, after))
    m1_before = _rotated(reference_before, before, v["theta0"])
    m1_after = _rotated(reference_after, after, v["theta1"])
    kappa1 = 0.5 * ca.dot(binormal, _cross(before, m1_before) + _cross(after, m1_after))
    kappa2 = -0.5 * ca.dot(binormal, m1_before + m1_after)
    bending = (kappa1 - p["rest_curvature"][0]) ** 2 + (kappa2 - p["rest_curvature"][1]) ** 2
    return 0.5 * p["bend_stiffness"] * bending + 0.5 * p["twist_stiffness"] * (twist - p["rest_twist"]) ** 2


_EDGE = {"x0": 3, "x1": 3, "before": 3, "after": 3}
STRETCH = StencilEnergy("stretch", _EDGE, {"rest_length": 1, "stiffness": 1, "turns": 2}, _stretch)
"""½ k_s l ε² of an edge x0–x1 between two others; ``stiffness`` k_s [N], ``rest_length`` l [m].

``turns``: 1 where the turn at x0 or x1 counts, 0 at the end of a yarn and of straight segments (polylines); ``before``
or ``after`` is then any other point.
"""

TWO_PHASE_STRETCH = StencilEnergy(
    "two_phase_stretch",
    _EDGE,
    {"rest_length": 1, "stiffness": 1, "stiff": 1, "knee": 1, "turns": 2},
    _two_phase_stretch,
)
"""EST22 eq. 5: ``stiffness`` k_s1 up to the strain ``knee`` ε̄, ``stiff`` k_s2 beyond it and in compression [N]."""

BEND_TWIST = StencilEnergy(
    "bend_twist",
    {"x0": 3, "x1": 3, "x2": 3, "theta0": 1, "theta1": 1},
    {
        "tangent0": 3,
        "tangent1": 3,
        "director0": 3,
        "director1": 3,
        "reference_twist": 1,
        "rest_curvature": 2,
        "rest_twist": 1,
        "bend_stiffness": 1,
        "twist_stiffness": 1,
    },
    _bend_twist,
)
"""Bending ½ (k_b/ℓ) |κ − κ̄|² and twist ½ (k_t/ℓ) (m − m̄)² at a joint.

``bend_stiffness`` k_b/ℓ and ``twist_stiffness`` k_t/ℓ [J]; anchors: unit tangents and directors of both edges.
"""

ANCHORS = ("tangent0", "tangent1", "director0", "director1")
"""Parameters of ``BEND_TWIST`` that follow the macroscopic state."""


@cache
def _anchor_kernel() -> Kernel:
    edge, tangent, director = (ca.SX.sym(name, 3) for name in ("edge", "tangent", "director"))
    end = _unit(edge)
    anchor = ca.vertcat(end, _transport(director, tangent, end))
    slope = ca.jacobian(anchor, ca.vertcat(edge, tangent, director))
    function = ca.Function("anchor", [edge, tangent, director], [anchor, ca.vec(ca.densify(slope).T)], {"cse": True})
    return compile_kernel(function, "anchor")


def carried_frames(edge: Array, tangent: Array, director: Array) -> tuple[Array, Array, Array]:
    """Frames (unit tangent, director) transported to the directions of edges, all (n, 3).

    Returns the tangents (n, 3), the directors (n, 3), and the derivatives of both by (edge, tangent, director),
    (n, 6, 9).
    """
    anchor, slope = run_columns(_anchor_kernel(), edge, tangent, director)
    return anchor[:, :3], anchor[:, 3:], slope.reshape(-1, 6, 9)
