"""Share of a cloth whose states are outside the samples of its material."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from yarnscale.arrays import Array
from yarnscale.shell.materials.compact import CompactMaterial

if TYPE_CHECKING:
    from yarnscale.shell.elastic.elements import ShellElements
    from yarnscale.shell.elastic.energy import ShellEnergy

_LEAST_SIDE, _LARGEST_SHEAR = 1e-3, 0.999


@dataclass(frozen=True)
class OutOfRange:
    """Shares of the triangles, and of the elastic energy above the least density, outside the samples; the farthest.

    farthest: of ``CompactMaterial.outside``.
    """

    triangles: float
    energy: float
    farthest: float

    def plain(self) -> dict[str, float]:
        """As JSON values."""
        return {"triangles": self.triangles, "energy": self.energy, "farthest": self.farthest}


def out_of_range(energy: ShellEnergy, positions: Array) -> OutOfRange | None:
    """Of a cloth at positions (nv, 3) [m]; None for a material without samples."""
    material, elements = energy.material, energy.elements
    if not isinstance(material, CompactMaterial):
        return None
    areas = elements.areas.ravel()
    there = areas > 0.0
    outside = outside_of(elements, material, positions)[there]
    density = energy.densities(positions).ravel()[there] - material.constant
    stored = density * areas[there]
    far = outside > 0.0
    return OutOfRange(float(np.mean(far)), float(stored[far].sum() / max(stored.sum(), 1e-300)), float(outside.max()))


def outside_of(elements: ShellElements, material: CompactMaterial, positions: Array) -> Array:
    """How far every element at positions (nv, 3) [m] lies outside the samples (``CompactMaterial.outside``), (n,)."""
    forms = np.moveaxis(elements.forms(positions), 1, -1).reshape(-1, 6)
    a, b = (np.sqrt(np.maximum(forms[:, k], _LEAST_SIDE**2)) for k in (0, 2))
    shear = np.clip(forms[:, 1] / (a * b), -_LARGEST_SHEAR, _LARGEST_SHEAR)
    return material.outside(np.column_stack([a - 1.0, shear, b - 1.0, forms[:, 3:]]))
