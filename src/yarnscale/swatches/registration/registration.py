"""Yarns registered to photographs: the state that a user corrects, and the steps that change it (EST22 §4.2)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from yarnscale.arrays import Array
from yarnscale.drawing.library import Structure
from yarnscale.drawing.stitch_size import EDGE_LENGTH
from yarnscale.errors import InputError
from yarnscale.swatches.registration import fit, start
from yarnscale.swatches.registration.curves import YarnCurves
from yarnscale.swatches.registration.lattice import FEWEST_PIXELS, Lattice, folded
from yarnscale.swatches.registration.relief import BACK, FRONT, Relief
from yarnscale.yarn.clearance import check_clearance
from yarnscale.yarn.pattern import YarnPattern

LARGEST_PERIOD = 4800
"""Longest period that is set by hand [pixels]."""
FLATTEST = 0.3
"""Least sine of the angle between course and wale that are set by hand."""
SIDES = {"front": FRONT, "back": BACK}
_VISIBLE = 0.35
"""Depth below the crest at which a sample still counts as seen [r]."""


@dataclass(frozen=True, eq=False)
class Registration:
    """Yarns over two photographs.

    curves: of one period [m]. lattices: of each side's photograph, where the curves lie in it. pixel: its size [m].
    pins: control points set by hand, by number. explained: share of each picture's brightness (R²), empty after changes
    by hand. apart: whether a fit has kept yarns from running through each other since the last such change.
    """

    curves: YarnCurves
    lattices: Mapping[str, Lattice]
    pixel: float
    pins: frozenset[int] = field(default_factory=frozenset)
    explained: Mapping[str, float] = field(default_factory=dict)
    apart: bool = False

    def moved(self, side: str, point: int, place: Array) -> Registration:
        """A control point set by hand to a pixel (2,) of a side's photograph, or to one of its copies there."""
        if not 0 <= point < len(self.curves.controls):
            raise InputError("control point", expected=f"0 to {len(self.curves.controls) - 1}", found=point)
        target = self.lattices[side].periods(np.asarray(place, dtype=float)[None])[0] * self.curves.period
        controls = self.curves.controls.copy()
        away = target - controls[point, :2]
        controls[point, :2] += away - np.rint(away / self.curves.period) * self.curves.period
        curves = replace(self.curves, controls=controls)
        return replace(self, curves=curves, pins=self.pins | {point}, explained={}, apart=False)

    def with_lattice(self, side: str, lattice: Lattice) -> Registration:
        """The period of one photograph set by hand; the fabric's is the mean of both.

        Raises InputError for periods that are mirrored, nearly flat, or of sizes that no fabric in a picture has.
        """
        what, sizes = f"period of the {side}", np.linalg.norm(lattice.matrix, axis=0)
        least, most = max(FEWEST_PIXELS, 2.0 * self.curves.radius / self.pixel), LARGEST_PERIOD
        if not (np.isfinite(lattice.origin).all() and (sizes >= least).all() and (sizes <= most).all()):
            found = f"{sizes[0]:.3g} × {sizes[1]:.3g}"
            raise InputError(what, expected=f"{least:.3g} to {most} pixels each way", found=found)
        area = np.linalg.det(lattice.matrix) * np.sign(np.linalg.det(self.lattices[side].matrix))
        if area < FLATTEST * sizes.prod():
            expected = "course and wale across each other, not mirrored"
            raise InputError(what, expected=expected, found="mirrored" if area < 0.0 else "nearly one direction")
        known = {**self.lattices, side: lattice}
        period = self.pixel * start.mean_period(known)
        stretch = period / self.curves.period
        curves = replace(self.curves, controls=self.curves.controls * [*stretch, 1.0], period=period)
        return replace(self, lattices=known, curves=curves, explained={}, apart=False)

    def seen(self, side: str) -> NDArray[np.bool_]:
        """Which samples of the curves a side shows (m,)."""
        curves, sign = self.curves, SIDES[side]
        shape = fit.shape_of_cell(curves.period, curves.radius, 10.0)
        relief = Relief.of(curves.samples, curves.following, curves.sample_radii, curves.period, shape, sign)
        size = np.array([shape[1], shape[0]])
        at = np.floor(curves.samples[:, :2] / curves.period * size).astype(int) % size
        crest = sign * curves.samples[:, 2] + curves.sample_radii
        return np.abs(relief.height[at[:, 1], at[:, 0]] - crest) < _VISIBLE * curves.sample_radii

    def fitted(self, pictures: Mapping[str, Array], *, progress: Callable[[str], object] | None = None) -> Registration:
        """The curves moved onto evened pictures (``start.flattened``), points set by hand staying where they are.

        progress: called at every step with a text.
        """
        curves, shape = self.curves, fit.shape_of_cell(self.curves.period, self.curves.radius)
        views = [
            fit.View(folded(flat, self.lattices[side], shape), SIDES[side], np.zeros(2))
            for side, flat in pictures.items()
        ]
        pins = {point: curves.controls[point, :2] for point in self.pins}
        found = fit.fitted(curves, views, pins=pins, progress=progress)
        return self.taken(found, list(pictures), apart=True)

    def taken(self, found: fit.Fitted, sides: list[str], *, apart: bool) -> Registration:
        """The outcome of a fit, its phases moved into the lattices."""
        lattices = dict(self.lattices)
        for side, view in zip(sides, found.views, strict=True):
            lattice = lattices[side]
            lattices[side] = replace(lattice, origin=lattice.pixels(view.phase / self.curves.period))
        return replace(
            self,
            curves=found.curves,
            lattices=lattices,
            explained=dict(zip(sides, found.explained, strict=True)),
            apart=apart,
        )

    def pattern(self, drawing: YarnPattern) -> YarnPattern:
        """The registered pattern with the name and materials of its drawing; its shape is its rest shape.

        Raises InputError where yarns run through each other.
        """
        curves = self.curves if self.apart else fit.apart(self.curves)
        pattern = curves.pattern(
            name=drawing.name, edge=EDGE_LENGTH, yarn_material=drawing.yarn_material, rest_shape="current"
        )
        check_clearance(pattern, where="registration")
        return pattern


def registered(
    structure: Structure,
    pictures: Mapping[str, Array],
    *,
    pixel: float,
    name: str,
    radius: float | None = None,
    period: Array | None = None,
) -> tuple[YarnPattern, Registration]:
    """The drawing and the first guess: periods, radius and place of a structure's yarns on evened pictures.

    pictures: brightness by side (``start.flattened``). pixel: size of a pixel [m]. radius: of the yarn [m], measured
    from the pictures if None. period: known nearly (2,) [m].
    Raises InputError for pictures that do not repeat and structures that cannot be drawn.
    """
    known = None if period is None else (float(period[0] / pixel), float(period[1] / pixel))
    found = start.lattices(pictures, structure, known)
    period = pixel * start.mean_period(found)
    if radius is None:
        radius = pixel * start.ridge_radius(pictures, found)
    drawing, curves = start.drawn(structure, period, radius, name=name)
    shape, blur = fit.shape_of_cell(period, radius), 0.3 * radius
    guess = Registration(curves, found, pixel)
    views, explained = [], []
    for side, flat in pictures.items():
        view = fit.View(folded(flat, found[side], shape), SIDES[side], np.zeros(2))
        view, share = fit.phased(view, curves, blur)
        views.append(view)
        explained.append(share)
    return drawing, guess.taken(fit.Fitted(curves, tuple(views), tuple(explained)), list(pictures), apart=False)
