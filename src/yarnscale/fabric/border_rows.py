"""Rows of a fabric that are full yarns, beside rows that follow from something else."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from yarnscale.arrays import Array, Integers
from yarnscale.fabric.bspline import ORDER
from yarnscale.fabric.spline_contacts import StitchSprings, stitch_stiffness
from yarnscale.fabric.spline_knit import SplineFabric
from yarnscale.fabric.spline_model import evenly_shifted, spline_parameters
from yarnscale.fabric.spline_points import SplinePoints
from yarnscale.fabric.spline_touch import SplineTouch
from yarnscale.fabric.spline_yarn import SPLINE_SEGMENT
from yarnscale.numerics.assembly import StencilSet, position_variables
from yarnscale.numerics.block_pattern import BlockPattern
from yarnscale.numerics.regularisation import ShiftedHessian

_MOST_APART = 4.0
"""How much farther apart than where they touch chords may be at rest to have a place in Hessians of full yarns [r]."""


class BorderRows:
    """Energy [J] of some rows of a fabric, as a function of the control points (n, 3) [m] of all its rows.

    It is that of their own segments, and of their stitches and contact with each other and with the other rows. Springs
    keep the stitches as in cells (``StitchSprings``).
    """

    def __init__(self, fabric: SplineFabric, own: Integers) -> None:
        """own: the rows, increasing."""
        rest = fabric.control.reshape(-1, 3)
        segments = fabric.segments.reshape(fabric.yarn_count, -1, ORDER)[own].reshape(-1, ORDER)
        variables = position_variables(segments)
        self._segments = StencilSet(SPLINE_SEGMENT, variables, spline_parameters(fabric, rest, segments), 4)
        kept = np.isin(fabric.first.yarn, own) | np.isin(fabric.second.yarn, own)
        sides = [points.some(kept) for points in (fabric.first, fabric.second)]
        nodes, weights = (np.stack(parts, axis=1) for parts in zip(*map(fabric.rows, sides), strict=True))
        slopes = np.stack([fabric.rows(side, 1)[1] for side in sides], axis=1)
        self._stitches = StitchSprings(nodes, weights, slopes, rest, np.array([stitch_stiffness(fabric)]))
        self.touch = SplineTouch(SplinePoints(fabric), own=own)
        tied = position_variables(self._stitches.nodes)
        blocks = BlockPattern.of(np.full(len(rest), 3), [variables, tied])
        self._pattern, self._slots = blocks.pattern, blocks.slots(variables)
        lower = np.tril_indices(tied.shape[1])
        slots = blocks.slots(tied).transpose(0, 2, 1).reshape(-1, len(lower[0]))
        self._stitch_slots, self._lower = slots[: len(tied)].ravel(), lower
        self.meeting = _incidence([segments, self._stitches.nodes, self.touch.near(_MOST_APART)], len(rest))
        """Elements (e, n) with the control points that meet in each: segments, stitches, pairs that may touch."""

    def value(self, control: Array) -> float:
        """Energy [J]."""
        x = control.ravel()
        return self._segments.value(x) + self._stitches.value(control[None]) + self.touch.value(x)

    def gradient(self, control: Array) -> tuple[float, Array]:
        """Energy [J] and gradient (n, 3) [N]."""
        force = np.zeros_like(control)
        value = self._segments.gradient(control.ravel(), force.ravel())
        value += self._stitches.gradient(control[None], force[None])
        pressed, push = self.touch.gradient(control.ravel())
        return value + pressed, force + push.reshape(-1, 3)

    def quadratic(self, control: Array) -> tuple[float, Array, ShiftedHessian]:
        """Energy [J], gradient (n, 3) [N] and Hessian [N/m]."""
        force, entries = np.zeros_like(control), np.zeros(self._pattern.entries)
        value = self._segments.hessian(control.ravel(), force.ravel(), self._slots, np.empty((0, 3, 3)), entries)
        value += self._stitches.gradient(control[None], force[None])
        wide = np.kron(self._stitches.ties, np.eye(3)).reshape(-1, 9, 24)
        hessians = wide.transpose(0, 2, 1) @ self._stitches.hessians(control[None]) @ wide
        lower = hessians[:, self._lower[0], self._lower[1]].ravel()
        twice = self._stitch_slots < -1  # on the diagonal, where both points of a stitch follow from one control point
        places = np.where(twice, -self._stitch_slots - 2, self._stitch_slots)
        entries += np.bincount(places, np.where(twice, 2.0, 1.0) * lower, len(entries))
        model = evenly_shifted(self._pattern, entries)
        pressed, push, model = self.touch.quadratic(control.ravel(), model)
        return value + pressed, force + push.reshape(-1, 3), model


def _incidence(elements: list[Integers], count: int) -> csr_array:
    parts = [nodes.ravel() for nodes in elements]
    sizes = np.concatenate([np.full(len(nodes), nodes.shape[1]) for nodes in elements])
    columns, begin = np.concatenate(parts), np.concatenate([[0], np.cumsum(sizes)])
    return csr_array((np.ones(len(columns)), columns, begin), shape=(len(sizes), count))
