"""The six membrane constants of the orthotropic shell as bounded unknowns of a fit.

Stiffnesses enter as logarithms, k_xy as its ratio to √(k_xx k_yy), whose magnitude stays below one so that the
energy is bounded below, and the area terms, which may vanish, as multiples of a reference stiffness.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yarnscale.shell.materials.orthotropic import OrthotropicMaterial

Array = NDArray[np.float64]

MEMBRANE = ("stretch_weft", "stretch_coupling", "stretch_warp", "shear", "area", "log_area")
"""Constants of EST22 eq. 1: k_xx, k_xy, k_yy, k_ss, k_n1, k_n2 [N/m]."""

_DECADES = 4.0
_TIGHTEST = 0.995
_LARGEST_AREA = 30.0
_LEAST_LOG_AREA = 1e-3
"""The log term of the area alone keeps cloth from shrinking to nothing across (EST22 Fig. 5)."""


@dataclass(frozen=True)
class MembraneUnknowns:
    """Unknowns (6,) of a fabric whose stiffness is about ``reference`` [N/m]; their order is that of ``MEMBRANE``."""

    reference: float

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Least and largest unknowns."""
        wide = _DECADES * math.log(10.0)
        high = np.array([wide, _TIGHTEST, wide, wide, _LARGEST_AREA, _LARGEST_AREA])
        low = np.array([-wide, -0.9, -wide, -wide, 0.0, _LEAST_LOG_AREA])
        return low, high

    @property
    def prior(self) -> Array:
        """What is taken for constants of which the measurements say nothing: an isotropic fabric without area terms."""
        return np.array([0.0, 0.3, 0.0, math.log(0.35), 0.0, 0.0])

    def constants(self, unknowns: Array) -> Array:
        """k_xx, k_xy, k_yy, k_ss, k_n1, k_n2 [N/m]."""
        weft, warp, shear = self.reference * np.exp(unknowns[[0, 2, 3]])
        area, log_area = self.reference * np.maximum(unknowns[4:], 0.0)
        return np.array([weft, unknowns[1] * math.sqrt(weft * warp), warp, shear, area, log_area])

    def unknowns(self, constants: Array) -> Array:
        """The inverse of ``constants``."""
        weft, coupling, warp, shear = constants[:4]
        logs = np.log(np.array([weft, warp, shear]) / self.reference)
        return np.array(
            [logs[0], coupling / math.sqrt(weft * warp), logs[1], logs[2], *constants[4:] / self.reference]
        )

    def jacobian(self, unknowns: Array) -> Array:
        """d(constants)/d(unknowns), (6, 6)."""
        weft, coupling, warp, shear, _, _ = self.constants(unknowns)
        matrix = np.diag([weft, math.sqrt(weft * warp), warp, shear, self.reference, self.reference])
        matrix[1, [0, 2]] = coupling / 2
        return matrix

    def material(self, unknowns: Array, *, density: float = 0.2) -> OrthotropicMaterial:
        """The material without bending."""
        return OrthotropicMaterial(*(float(k) for k in self.constants(unknowns)), density=density)
