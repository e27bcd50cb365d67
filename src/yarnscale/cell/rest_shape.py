"""A pattern redrawn at a flat equilibrium, and the rest shape of its yarns taken from their present shape."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.errors import InputError
from yarnscale.kinematics import ShellStrain
from yarnscale.yarn.frames import carried, material_curvature, parallel_transport, reference_twist, unit, upright
from yarnscale.yarn.pattern import YarnPattern


def rebased(pattern: YarnPattern, state: Equilibrium) -> YarnPattern:
    """The pattern whose drawn shape is a flat equilibrium without shear.

    Vertices and periods are those of the state, and the rest shape of the yarns (rest length, curvature, twist) stays.
    Directors are carried to the new tangents by the transports that the energy itself makes (rest → affine → relaxed),
    so that every strain measure, and the energy of the period, is the same: the new pattern is in equilibrium without
    fluctuation at rest.

    Raises InputError for a state with shear or curvature: the periods of a pattern are orthogonal and flat.
    """
    strain = state.strain
    if strain.s_a != 0.0 or not strain.is_flat:
        raise InputError(
            "only a flat state without shear can become a rest shape",
            expected="s_a = 0 and II = 0",
            found=f"s_a = {strain.s_a:g}, II = ({strain.II11:g}, {strain.II12:g}, {strain.II22:g}) 1/m",
        )
    if len(state.positions) != len(pattern.edges):
        raise InputError(
            "the state belongs to another pattern",
            expected=f"{len(pattern.edges)} vertices",
            found=len(state.positions),
        )
    return redrawn(pattern, strain, state.positions, state.twist)


def redrawn(pattern: YarnPattern, strain: ShellStrain, positions: Array, twist: Array) -> YarnPattern:
    """The pattern drawn at positions (n, 3) [m] and twists (n,), its periods stretched; rest shapes of yarns stay."""
    stretch = np.array([1.0 + strain.s_x, 1.0 + strain.s_y, 1.0])
    period = pattern.period * stretch[:2]
    edge = pattern.edge_vectors()
    rest, affine = unit(edge), unit(edge * stretch)
    moved = positions[pattern.edges[:, 1]] - positions
    moved[:, :2] += pattern.edges[:, 2:] * period
    tangent = unit(moved)
    director = parallel_transport(upright(pattern.reference_director, rest), rest, affine)
    director, previous = carried(affine, tangent, director), pattern.previous_vertex
    return replace(
        pattern,
        vertices=positions,
        twist=twist,
        reference_director=director,
        reference_twist=reference_twist(tangent, director, previous, pattern.reference_twist),
        period=period,
    )


def set_as_drawn(pattern: YarnPattern, *, share: float = 1.0, lengths: bool = True) -> YarnPattern:
    """The pattern whose yarns have taken on the shape they are drawn in (HYLC20 fig. 10, EST22 §7.2).

    Rest curvatures and twists, and rest lengths unless ``lengths`` is false, move by ``share`` of the difference from
    what they are to what the drawing has.
    """
    tangent, previous = unit(pattern.edge_vectors()), pattern.previous_vertex
    director = upright(pattern.reference_director, tangent)
    drawn = replace(
        pattern,
        rest_length=pattern.drawn_length if lengths else pattern.rest_length,
        rest_curvature=material_curvature(tangent, director, pattern.twist, previous),
        rest_twist=pattern.twist - pattern.twist[previous] + pattern.reference_twist,
    )
    return with_rest_moved(pattern, pattern, drawn, share)


def with_rest_moved(pattern: YarnPattern, before: YarnPattern, after: YarnPattern, share: float) -> YarnPattern:
    """The pattern with the rest shape of its yarns moved by a share of the difference between two others."""
    moved = {
        name: getattr(pattern, name) + share * (getattr(after, name) - getattr(before, name))
        for name in ("rest_length", "rest_curvature", "rest_twist")
    }
    return replace(pattern, **moved)
