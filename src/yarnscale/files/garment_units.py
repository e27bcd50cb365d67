"""Units of a garment's file: how long a unit of its positions and of its fabric is, and whether both fit."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from yarnscale.errors import InputError
from yarnscale.kinematics import INCH

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "inch": INCH}
"""Units [m] that a scene may name."""
NOTED, REFUSED = 1.2, 10.0
"""Area in space over area of the fabric, or the reverse: reported beyond the first, refused beyond the second."""
Notice = Callable[[str], object]


@dataclass(frozen=True)
class Areas:
    """Areas of all polygons as the file has them, in its units squared: in space, and in the fabric."""

    space: float
    fabric: float

    def ratio(self, scale: float, material_scale: float) -> float:
        """Area in space over area of the fabric, at metres per unit of each."""
        return self.space / self.fabric * (scale / material_scale) ** 2


def length(unit: str) -> float:
    """Metres per unit; InputError for one that is not among ``LENGTHS``."""
    if unit not in LENGTHS:
        raise InputError("unit", expected=" or ".join(LENGTHS), found=repr(unit)[:60])
    return LENGTHS[unit]


def scales(areas: Areas, unit: str | None, scale: float | None, material_scale: float | None) -> tuple[float, float]:
    """Metres per unit of space and of the fabric.

    ``unit`` is that of the file. Where positions and texture coordinates have different units, it is that of one of
    them and the other is in metres: whichever makes both of one size. A scale that is given counts for its own.
    """
    if unit is None:
        return scale or 1.0, material_scale or 1.0
    metres = length(unit)
    if scale is not None and material_scale is not None:
        raise InputError("unit", expected="none beside scale and material_scale", found=repr(unit))
    if scale is not None or material_scale is not None:
        return scale or metres, material_scale or metres
    options = [(metres, metres), (1.0, metres), (metres, 1.0)]
    return min(options, key=lambda pair: abs(math.log(areas.ratio(*pair))))


def check_ratio(
    areas: Areas, scale: float, material_scale: float, sizes: str, on_notice: Notice, *, stated: bool = False
) -> None:
    """Report a fabric that is not as large as what is made of it; InputError beyond ``REFUSED`` unless both scales
    are stated."""
    ratio = areas.ratio(scale, material_scale)
    if max(ratio, 1 / ratio) <= NOTED:
        return
    found = f"{sizes}: {ratio:.3g} times the area"
    if stated or max(ratio, 1 / ratio) <= REFUSED:
        on_notice(f"fabric and cloth in space differ in size: {found}{_remedy(areas)}")
        return
    raise InputError("sizes", expected="a fabric as large as the cloth in space" + _remedy(areas), found=found)


def _remedy(areas: Areas) -> str:
    """Which units would make both of one size, else which scale of the fabric would."""
    others = [unit for unit in LENGTHS if unit != "m"]
    pairs = [*(("m", unit) for unit in others), *((unit, "m") for unit in others), ("mm", "cm"), ("cm", "mm")]
    for space, fabric in pairs:
        ratio = areas.ratio(LENGTHS[space], LENGTHS[fabric])
        if max(ratio, 1 / ratio) > 2 * NOTED:
            continue
        if fabric == "m":
            return f' (positions in {space} would fit: unit = "{space}")'
        if space == "m":
            return f' (texture coordinates in {fabric} would fit: unit = "{fabric}")'
        scales = f"scale = {LENGTHS[space]:g}, material_scale = {LENGTHS[fabric]:g}"
        return f" (positions in {space} and texture coordinates in {fabric} would fit: {scales})"
    return f" (material_scale = {math.sqrt(areas.space / areas.fabric):.3g} would fit)"
