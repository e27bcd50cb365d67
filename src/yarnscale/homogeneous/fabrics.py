"""What has one macroscopic strain everywhere: a periodic cell of yarns, or a piece of shell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.equilibrium import Equilibrium
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.kinematics import ShellStrain, strain_units
from yarnscale.shell.materials.material import ShellMaterial

TIGHTEST = 0.4
"""Largest curvature times yarn radius of a cell: beyond it a surface of yarns runs into itself."""


@dataclass(frozen=True, eq=False)
class Response:
    """Fabric under one strain: energy density [J/m²], stress (6,), and whether it is an equilibrium of this fabric.

    state: what neighbouring responses start from.
    """

    strain: Array
    energy: float
    stress: Array
    usable: bool = True
    state: Any = None

    @classmethod
    def of(cls, state: Equilibrium) -> Response:
        """A relaxed cell."""
        return cls(state.strain.vector, state.energy_density, state.stress, state.usable, state)


class HomogeneousFabric(Protocol):
    """Fabric that answers to a macroscopic strain: a periodic cell of yarns, or a shell material.

    strain_scale: strains (6,) of like importance, by which steps and residuals are measured. response: energy and
    stress under a strain (6,), from a neighbouring response or from rest. moduli: second derivatives of the energy
    (6, 6); ArithmeticError where there are none (the verge of buckling).
    """

    @property
    def strain_scale(self) -> Array: ...
    def response(self, strain: Array, start: Response | None = None) -> Response: ...
    def moduli(self, response: Response) -> Array: ...


def moduli_or_nan(fabric: HomogeneousFabric, response: Response) -> Array:
    """Second derivatives of the energy (6, 6), NaN where it is no equilibrium or on the verge of buckling."""
    if response.usable:
        try:
            return fabric.moduli(response)
        except ArithmeticError:
            pass
    return np.full((6, 6), np.nan)


def fabric_of(subject: PeriodicCell | ShellMaterial) -> HomogeneousFabric:
    """A cell of yarns or a shell material as homogeneous fabric."""
    return CellFabric(subject) if isinstance(subject, PeriodicCell) else MaterialFabric(subject)


@dataclass(frozen=True, eq=False)
class CellFabric:
    """A periodic cell; the ``state`` of its responses is the ``Equilibrium``."""

    cell: PeriodicCell

    @property
    def strain_scale(self) -> Array:
        """A half in-plane; a tenth of the yarn's curvature in bending [1/m]."""
        return strain_units(self.cell.pattern.radius)

    def response(self, strain: Array, start: Response | None = None) -> Response:
        """Relax the yarns under a strain (6,)."""
        strain = np.array(strain, np.float64)
        if np.abs(strain[3:]).max() * self.cell.pattern.radius > TIGHTEST:
            return Response(strain, np.nan, np.full(6, np.nan), usable=False)
        near = None if start is None else start.state
        return Response.of(self.cell.relax(ShellStrain.from_vector(strain), start=near, nearby=True))

    def moduli(self, response: Response) -> Array:
        """Moduli (6, 6) with the yarns following, as ``PeriodicCell.moduli``."""
        return self.cell.moduli(response.state)


@dataclass(frozen=True, eq=False)
class MaterialFabric:
    """A piece of shell."""

    material: ShellMaterial

    @property
    def strain_scale(self) -> Array:
        return self.material.strain_scale

    def response(self, strain: Array, start: Response | None = None) -> Response:
        energy, stress = float(self.material.energy_density(strain)), self.material.stress(strain)
        return Response(np.array(strain, np.float64), energy, stress, bool(np.isfinite(energy)))

    def moduli(self, response: Response) -> Array:
        return self.material.moduli(response.strain)
