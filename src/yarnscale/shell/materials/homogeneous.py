"""A shell material as homogeneous fabric, which ``numerics.loads`` puts under loads."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from yarnscale.numerics.loads import Response
from yarnscale.shell.materials.material import ShellMaterial

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MaterialFabric:
    """A piece of shell under one strain."""

    material: ShellMaterial

    @property
    def strain_scale(self) -> Array:
        """Strains (6,) of like importance."""
        return self.material.strain_scale

    def response(self, strain: Array, start: Response | None = None) -> Response:
        """Energy and stress at a strain (6,)."""
        energy, stress = float(self.material.energy_density(strain)), self.material.stress(strain)
        return Response(np.array(strain, np.float64), energy, stress, bool(np.isfinite(energy)))

    def moduli(self, response: Response) -> Array:
        """Second derivatives (6, 6)."""
        return self.material.moduli(response.strain)
