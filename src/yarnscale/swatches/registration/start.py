"""The first guess: size, radius and place of a fabric from its chart and two photographs, before any yarn is fitted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import ndimage

from yarnscale.arrays import Array
from yarnscale.drawing.library import Structure
from yarnscale.errors import InputError
from yarnscale.swatches.registration.curves import YarnCurves
from yarnscale.swatches.registration.lattice import Lattice, even, folded, lattice_of
from yarnscale.yarn.pattern import YarnPattern

RIDGE = 0.507
"""Standard deviation of the Gaussian that answers most to the ridge of a lit yarn, in rendered knits [r]; 0.45 for
cylinders side by side, 0.67 for one alone."""
_BRIGHTEST = 0.97
"""Share of the pixels that are no crest of a ridge."""
LARGEST_DIFFERENCE = 0.05
"""Difference of the periods in both photographs, relative, from which their scales differ."""
_THINNER = 0.93


def repeat_of(structure: Structure) -> tuple[float, float]:
    """Smallest repeat of a chart or draft with its kinds of yarn: its share along the course and the wale direction."""
    if structure.draft is not None:
        rows = ["".join(map(str, row)) for row in structure.draft.tolist()]
    else:
        rows = list(structure.chart)
    kinds = structure.sizes.get("yarns") or structure.sizes.get("weft_yarns") or [""] * len(rows)
    warp = structure.sizes.get("warp_yarns") or ""
    beds = [row.split("|") for row in rows]
    columns = list(zip(*(zip(*bed, strict=True) for bed in beds), strict=True))
    if len(warp) == len(columns):
        columns = list(zip(columns, warp, strict=True))
    return _share(columns), _share(list(zip(rows, kinds, strict=True)))


def _share(entries: list) -> float:
    count = len(entries)
    shortest = next(n for n in range(1, count + 1) if count % n == 0 and entries == entries[:n] * (count // n))
    return shortest / count


def lattices(
    pictures: Mapping[str, Array], structure: Structure, period: tuple[float, float] | None = None
) -> dict[str, Lattice]:
    """The chart's period in each evened picture by its side; on the back the course runs to the left.

    period: its size (2,) [pixels] where it is known nearly.
    Raises InputError where a picture does not repeat, or the two differ in scale.
    """
    found, (across, up) = {}, repeat_of(structure)
    near = None if period is None else (period[0] * across, period[1] * up)
    for side, flat in pictures.items():
        try:
            one = lattice_of(flat, near)
        except InputError as error:
            raise error.at(f"--{side}") from None
        turn = -1.0 if side == "back" else 1.0
        found[side] = replace(one, course=one.course * turn / across, wale=one.wale / up)
    if len(found) == 2:
        front, back = (np.linalg.norm(found[side].matrix, axis=0) for side in ("front", "back"))
        if (np.abs(back / front - 1.0) > LARGEST_DIFFERENCE).any():
            sizes = " and ".join(f"{size[0]:.0f} × {size[1]:.0f} pixels" for size in (front, back))
            raise InputError(
                "periods of front and back differ",
                expected="pictures of one scale and repeat (--period says it)",
                found=sizes,
            )
    return found


def mean_period(found: Mapping[str, Lattice]) -> Array:
    """Period over both pictures (2,) [pixels]."""
    return np.mean([np.linalg.norm(lattice.matrix, axis=0) for lattice in found.values()], axis=0)


def ridge_radius(pictures: Mapping[str, Array], found: Mapping[str, Lattice]) -> float:
    """Radius of the yarn [pixels] from the width of bright ridges, mean over the pictures."""
    radii = []
    for side, flat in pictures.items():
        columns, rows = np.maximum(np.rint(np.linalg.norm(found[side].matrix, axis=0)), 8).astype(int)
        cell = folded(flat, found[side], (int(rows), int(columns)))
        widths = np.geomspace(0.8, 0.25 * min(rows, columns), 48)
        answers = np.array([_ridges(cell, width) for width in widths])
        best = int(np.argmax(answers))
        offset = 0.0
        if 0 < best < len(widths) - 1:
            low, here, high = answers[best - 1 : best + 2]
            offset = 0.5 * (low - high) / min(low - 2.0 * here + high, -1e-300)
        radii.append(float(np.exp(np.interp(best + offset, np.arange(len(widths)), np.log(widths)))) / RIDGE)
    return float(np.mean(radii))


def _ridges(cell: Array, width: float) -> float:
    """Strength of bright ridges of a width: largest downward curvature across, at the crests."""
    smooth: Any = ndimage.gaussian_filter
    xx, yy, xy = (smooth(cell, width, order=order, mode="wrap") for order in ((0, 2), (2, 0), (1, 1)))
    sharpest = 0.5 * (xx + yy) - np.sqrt(0.25 * (xx - yy) ** 2 + xy**2)
    return float(width**1.5 * np.quantile(np.maximum(-sharpest, 0.0), _BRIGHTEST))


def drawn(structure: Structure, period: Array, radius: float, *, name: str) -> tuple[YarnPattern, YarnCurves]:
    """The structure drawn with a period (2,) [m] and a radius [m], yarns as thin as there is room for in the drawing.

    Raises InputError where no drawing fits.
    """
    kept = {key: structure.sizes[key] for key in ("yarns", "weft_yarns", "warp_yarns") if key in structure.sizes}
    own = float(structure.sizes.get("radius", 1e-3))
    thick = {letter: value / own for letter, value in structure.sizes.get("yarn_radius", {}).items()}
    fault = InputError("structure cannot be drawn")
    for attempt in range(12):
        thin = radius * _THINNER**attempt
        sizes = dict(kept, radius=thin, name=name, **_spacings(structure, period / thin))
        if thick:
            sizes["yarn_radius"] = {letter: value * thin for letter, value in thick.items()}
        try:
            pattern = structure.maker(structure.chart if structure.draft is None else structure.draft, **sizes)
        except InputError as error:
            fault = error
            continue
        curves = YarnCurves.of(pattern)
        relative = curves.radii / curves.radii.max()
        return pattern, YarnCurves(curves.controls, curves.counts, curves.shifts, period, radius * relative)
    raise fault


def _spacings(structure: Structure, period: Array) -> dict[str, float]:
    """Spacings of a period (2,) [r] by their names."""
    if structure.draft is not None:
        picks, ends = structure.draft.shape
        return {"warp_spacing": float(period[0] / ends), "weft_spacing": float(period[1] / picks)}
    wales = len(structure.chart[0].replace("|", ""))
    return {"wale_spacing": float(period[0] / wales), "course_spacing": float(period[1] / len(structure.chart))}


def flattened(brightness: Mapping[str, Array]) -> dict[str, Array]:
    """Evened pictures by side."""
    return {side: even(picture) for side, picture in brightness.items()}
