"""A bounding volume that takes knots in where the motion asks for them, and gives them back; open in LOD03 §8.

A new knot changes neither positions nor velocities. What it is worth is the energy that the next implicit step could
save with it: ½ gᵀ K⁻¹ g with the gradient g and the matrix K of that step in the finer volume; in the volume as it is,
the gradient vanishes. A knot is given back where the motion, brought to the coarser volume by least squares in the mass
matrix, moves by less than a tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import csr_array

from yarnscale.errors import InputError
from yarnscale.fabric.spline_motion import SplineMotion, YarnMotion
from yarnscale.fabric.volume import DEGREE, BoundingVolume


@dataclass(frozen=True)
class AdaptiveRule:
    """When a volume changes.

    gain: energy that a knot must save in a step, as a share of the weight times the yarn's radius; loss: how far yarns
    may move when a knot is given back [yarn radii]; largest: most control points of a volume; narrowest: patches are
    not halved below this width [yarn radii], for a patch must hold yarn. Raises InputError.
    """

    gain: float = 1e-4
    loss: float = 1e-2
    largest: int = 200
    narrowest: float = 12.0

    def __post_init__(self) -> None:
        for name in ("gain", "loss", "narrowest"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise InputError(f"adaptive {name}", expected="a positive number", found=getattr(self, name))


@dataclass(frozen=True)
class Knot:
    """A knot that was put in: along axis 0 (x) or 1 (y), at a place [m]."""

    axis: int
    place: float


class AdaptiveVolume:
    """A moving fabric whose volume follows the motion; ``moving`` is the one at present."""

    def __init__(self, moving: SplineMotion, rule: AdaptiveRule = AdaptiveRule()) -> None:
        """moving: with a volume; the fabric never gets a coarser one. Raises InputError."""
        if moving.volume is None:
            raise InputError("adaptive volume", expected="a motion in a volume", found="the full yarns")
        self.moving, self.rule = moving, rule
        self.knots: list[Knot] = []
        self._coarsest = moving.volume

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
        reached = self.moving.step(motion, duration).motion
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
        return _changed(motion, change)

    def _coarsen(self, motion: YarnMotion) -> YarnMotion:
        for knot in reversed(self.knots):
            kept = [other for other in self.knots if other is not knot]
            volume = self._coarsest
            for other in kept:
                volume, _ = volume.refined(other.axis, other.place)
            coarser = self.moving.with_volume(volume)
            fitted, away = coarser.nearest(self.moving.yarns(motion))
            if away < self.rule.loss * self.moving.fabric.radius:
                self.moving, self.knots = coarser, kept
                return fitted
        return motion


def _changed(motion: YarnMotion, change: csr_array) -> YarnMotion:
    return YarnMotion(change @ motion.positions, change @ motion.velocities, motion.time)
