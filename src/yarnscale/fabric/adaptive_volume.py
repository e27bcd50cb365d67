"""A bounding volume that inserts knots where the motion needs them, and removes them; open in LOD03 §8.

A new knot changes neither positions nor velocities. Its gain is the energy that the next implicit step could
save with it: ½ gᵀ K⁻¹ g with the gradient g and the matrix K of that step in the finer volume; in the volume as it is,
the gradient vanishes. A knot is removed where the motion, projected to the coarser volume by least squares in the mass
matrix, moves by less than a tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array

from yarnscale.arrays import Array
from yarnscale.errors import InputError, positive
from yarnscale.fabric.spline_motion import SplineMotion, YarnMotion
from yarnscale.fabric.volume import DEGREE, BoundingVolume
from yarnscale.motion.body import Body, Step


@dataclass(frozen=True)
class AdaptiveRule:
    """When a volume changes.

    gain: energy that a knot must save in a step, as a share of the weight times the yarn's radius; loss: how far yarns
    may move when a knot is removed [yarn radii]; largest: most control points of a volume; narrowest: patches are
    not halved below this width [yarn radii], for a patch must hold yarn. Raises InputError.
    """

    gain: float = 1e-4
    loss: float = 1e-2
    largest: int = 200
    narrowest: float = 12.0

    def __post_init__(self) -> None:
        for name in ("gain", "loss", "narrowest"):
            positive(f"adaptive {name}", getattr(self, name))


@dataclass(frozen=True)
class Knot:
    """An inserted knot: along axis 0 (x) or 1 (y), at a place [m]."""

    axis: int
    place: float


class AdaptiveVolume(Body[YarnMotion]):
    """A moving fabric whose volume follows the motion, frame by frame; ``moving`` is the one at present."""

    def __init__(self, moving: SplineMotion, rule: AdaptiveRule = AdaptiveRule()) -> None:
        """moving: with a volume; the fabric never gets a coarser one. Raises InputError."""
        if moving.volume is None:
            raise InputError("adaptive volume", expected="a motion in a volume", found="the full yarns")
        if moving.reduction != "published":
            raise InputError("reduction of an adaptive volume", expected="published", found=moving.reduction)
        self.moving, self.rule = moving, rule
        self.knots: list[Knot] = []
        self._coarsest = moving.volume
        self.tolerance, self.off_place = moving.tolerance, moving.off_place
        self.halvings, self.method, self.loose = moving.halvings, moving.method, moving.loose

    def _step(
        self, state: YarnMotion, duration: float, inertia: bool, iterations: int | None, until: float
    ) -> Step[YarnMotion]:
        self.take_up(state)
        return self.moving.step(state, duration, inertia=inertia, iterations=iterations, until=until)

    def distances_from_places(self, state: YarnMotion) -> dict[str, float]:
        self.take_up(state)
        return self.moving.distances_from_places(state)

    def stable_step(self, state: YarnMotion) -> float:
        self.take_up(state)
        return self.moving.stable_step(state)

    def renewed(self, state: YarnMotion, duration: float) -> YarnMotion:
        self.take_up(state)
        return self.adapt(state, duration)

    def counts(self) -> dict[str, int]:
        return self.moving.counts()

    def yarns(self, state: YarnMotion) -> YarnMotion:
        self.take_up(state)
        return self.moving.yarns(state)

    def take_up(self, state: YarnMotion) -> None:
        """Set ``moving`` to the volume of a state."""
        if not np.array_equal(state.knots, _table(self.knots)):
            self.knots = [Knot(int(axis), float(place)) for axis, place in state.knots]
            self.moving = self.moving.with_volume(self._with_knots(self.knots))

    def _with_knots(self, knots: list[Knot]) -> BoundingVolume:
        return reduce(lambda volume, knot: volume.refined(knot.axis, knot.place)[0], knots, self._coarsest)

    @property
    def volume(self) -> BoundingVolume:
        """The volume at present."""
        assert self.moving.volume is not None
        return self.moving.volume

    def adapt(self, motion: YarnMotion, duration: float) -> YarnMotion:
        """The motion in a volume fit for a step of ``duration`` [s]: with one knot more, one less, or as it was."""
        gains = self.gains(motion, duration)
        scale = self.moving.force_scale * self.moving.fabric.radius
        if gains:
            best = max(gains, key=lambda knot: gains[knot])
            if gains[best] > self.rule.gain * scale:
                return self._refine(motion, best)
        return self._coarsen(motion)

    def gains(self, motion: YarnMotion, duration: float) -> dict[Knot, float]:
        """Energy [J] that each knot halfway between two could save in the next step."""
        volume, found = self.volume, {}
        reached = self.moving.step(motion, duration).state
        for axis, knots in enumerate((volume.x_knots, volume.y_knots)):
            inner = knots[DEGREE : len(knots) - DEGREE]
            for low, high in pairwise(inner):
                if high - low < 2.0 * self.rule.narrowest * self.moving.fabric.radius:
                    continue
                knot = Knot(axis, 0.5 * float(low + high))
                finer, change = volume.refined(axis, knot.place)
                if finer.count <= self.rule.largest:
                    moving = self.moving.with_volume(finer)
                    fine = _changed(motion, change), _changed(reached, change)
                    found[knot] = moving.still_to_gain(fine[0], duration, fine[1].positions)
        return found

    def _refine(self, motion: YarnMotion, knot: Knot) -> YarnMotion:
        finer, change = self.volume.refined(knot.axis, knot.place)
        self.moving = self.moving.with_volume(finer)
        self.knots.append(knot)
        return replace(_changed(motion, change), knots=_table(self.knots))

    def _coarsen(self, motion: YarnMotion) -> YarnMotion:
        for knot in reversed(self.knots):
            kept = [other for other in self.knots if other is not knot]
            coarser = self.moving.with_volume(self._with_knots(kept))
            fitted, away = coarser.nearest(self.moving.yarns(motion))
            if away < self.rule.loss * self.moving.fabric.radius:
                self.moving, self.knots = coarser, kept
                return replace(fitted, knots=_table(kept), passages=motion.passages)
        return motion


def _changed(motion: YarnMotion, change: csr_array) -> YarnMotion:
    # Steps begin anew: the state before was that of another volume.
    return replace(motion, positions=change @ motion.positions, velocities=change @ motion.velocities, before=None)


def _table(knots: list[Knot]) -> Array:
    return np.array([(knot.axis, knot.place) for knot in knots], np.float64).reshape(-1, 2)
