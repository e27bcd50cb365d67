"""Equilibria of a periodic cell under loads: the macroscopic strain is an unknown (see ``numerics.loads``)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from yarnscale.cell.periodic import PeriodicCell
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.loads import Held, LoadedState, Loads, Response, equilibrium_under

Array = NDArray[np.float64]

TIGHTEST = 0.4
"""Largest curvature times yarn radius that a cell is asked for: beyond it a surface of yarns runs into itself."""


@dataclass(frozen=True, eq=False)
class CellFabric:
    """A periodic cell as homogeneous fabric; the ``state`` of its responses is the ``Equilibrium``."""

    cell: PeriodicCell

    @property
    def strain_scale(self) -> Array:
        """A half in-plane; a tenth of the yarn's curvature in bending [1/m]."""
        return np.array([0.5] * 3 + [0.1 / self.cell.pattern.radius] * 3)

    def response(self, strain: Array, start: Response | None = None) -> Response:
        """Relax the yarns under a strain (6,)."""
        if np.abs(strain[3:]).max() * self.cell.pattern.radius > TIGHTEST:
            return Response(np.array(strain, np.float64), np.nan, np.full(6, np.nan), usable=False)
        seed = None
        if start is not None and start.state is not None:
            seed = start.state.strain, start.state.fluctuation, start.state.twist
        state = self.cell.relax_from(ShellStrain.from_vector(strain), seed)
        return Response(np.array(strain, np.float64), state.energy_density, state.stress, state.usable, state)

    def moduli(self, response: Response) -> Array:
        """Exact moduli (6, 6); ArithmeticError on the verge of buckling."""
        return self.cell.moduli(response.state)


def relax_under(
    cell: PeriodicCell,
    loads: Loads,
    *,
    held: Held | None = None,
    start: LoadedState | None = None,
    **options: Any,
) -> LoadedState:
    """The equilibrium of a cell under ``loads``, some strains ``held``; options as ``equilibrium_under``."""
    return equilibrium_under(CellFabric(cell), loads, held=held, start=start, **options)
