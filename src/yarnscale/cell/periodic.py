"""A periodic cell of yarn and its equilibria under macroscopic states (HYLC20 §5), with exact stress and moduli."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.cell.continuation import Continuation
from yarnscale.cell.energy import CellEnergy
from yarnscale.cell.equilibrium import Equilibrium, EquilibriumOptions, Start
from yarnscale.cell.poisson import cell_midsurface
from yarnscale.cell.sensitivity import Sensitivities, response, sensitivities
from yarnscale.checked import checked
from yarnscale.kinematics import ShellStrain
from yarnscale.numerics.threads import on_one_thread
from yarnscale.yarn.friction_pairs import FrictionPairs
from yarnscale.yarn.material import YarnMaterial
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.stiffness import Materials, PatternStiffness, materials_of


@checked
@dataclass(frozen=True, eq=False)
class PeriodicCell:
    """One period of a pattern made of a yarn material.

    material: one for all yarns, or a sequence that the pattern's ``yarn_material`` numbers; kept as a tuple then.
    sliding: whether each yarn may slide along itself as a whole; fixed by default, as published (EST22 §7.1).
    options: how its equilibria are found. friction_pairs: pairs that resist slip since a state (``CellHistory``).
    """

    pattern: YarnPattern
    material: Materials
    sliding: bool = False
    options: EquilibriumOptions = field(default=EquilibriumOptions(), kw_only=True)
    friction_pairs: FrictionPairs | None = field(default=None, kw_only=True, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.material, YarnMaterial):
            object.__setattr__(self, "material", materials_of(self.pattern, self.material))

    def __repr__(self) -> str:
        return f"PeriodicCell({self.pattern!r} of {self.material_name})"

    def with_options(self, **changes: Any) -> PeriodicCell:
        """The same cell with other ``EquilibriumOptions``, by their names."""
        return replace(self, options=replace(self.options, **changes))

    @property
    def materials(self) -> tuple[YarnMaterial, ...]:
        """Materials by their number; one where it is that of all yarns."""
        return materials_of(self.pattern, self.material)

    @property
    def material_name(self) -> str:
        """Names of the materials."""
        return " + ".join(material.name for material in self.materials)

    @property
    def area_density(self) -> float:
        """Mass per reference area [kg/m²]."""
        return PatternStiffness.of(self.pattern, self.material).area_density()

    def energy(self, strain: ShellStrain) -> CellEnergy:
        """The energy of this cell under any state, as an objective of fluctuations and twists."""
        return CellEnergy(self.pattern, self.material, strain, self.sliding, friction_pairs=self.friction_pairs)

    def warm_up(self, strain: ShellStrain | None = None) -> None:
        """Compile or load what solves need, so that none of them pays for it."""
        energy = self.energy(ShellStrain() if strain is None else strain)
        start = energy.start()
        energy.value(start)
        energy.quadratic(start)
        energy.stress(start)

    @on_one_thread
    @checked
    def relax(
        self, strain: ShellStrain | None = None, *, start: Start | None = None, nearby: bool = False
    ) -> Equilibrium:
        """The equilibrium under a macroscopic state, from rest or from a start, such as a neighbouring equilibrium.

        Where the direct solve does not converge or yarns would pass through each other, intermediate states are
        relaxed first; an equilibrium with passages is no start. Look at ``status`` and ``passages``.
        nearby: one solve from the start, which may fail.
        """
        if isinstance(start, Equilibrium) and start.passages:
            start = None
        path = Continuation(self.pattern, self.material, self.sliding, self.options, self.friction_pairs)
        return path.equilibrium(ShellStrain() if strain is None else strain, start, nearby=nearby)

    def placement(self, state: Equilibrium | None) -> Callable[[Integers, Integers], Array]:
        """Positions of copies: a function of vertices (k,) and tiles (k, 2) to (k, 3) [m]; None: as drawn."""
        radius, n = self.pattern.radius, len(self.pattern.edges)
        surface = cell_midsurface(self.pattern, ShellStrain() if state is None else state.strain)
        fluctuation = np.zeros((n, 3)) if state is None else state.fluctuation

        def place(vertices: Integers, tiles: Integers) -> Array:
            reference = self.pattern.vertices[vertices].copy()
            reference[:, :2] += tiles * self.pattern.period
            points, rotations = surface.at(reference / radius)
            return points * radius + np.einsum("nij,nj->ni", rotations, fluctuation[vertices])

        return place

    def midsurface_grid(self, state: Equilibrium, *, rings: int = 1, points: int = 25) -> Array:
        """Points of the midsurface over the tile and ``rings`` rings of copies, (points, points, 3) [m]."""
        radius = self.pattern.radius
        centre = 0.5 * (self.pattern.vertices.min(axis=0) + self.pattern.vertices.max(axis=0))[:2]
        sides = (
            np.linspace(-rings - 0.5, rings + 0.5, points) * p + c
            for p, c in zip(self.pattern.period, centre, strict=True)
        )
        grid = np.stack(np.meshgrid(*sides, indexing="ij"), -1).reshape(-1, 2)
        surface = cell_midsurface(self.pattern, state.strain)
        flat, _ = surface.at(np.column_stack([grid, np.zeros(len(grid))]) / radius)
        return (flat * radius).reshape(points, points, 3)

    @on_one_thread
    @checked
    def moduli(self, state: Equilibrium) -> Array:
        """∂²Ψ/∂z² (6, 6) at an equilibrium, z = (s_x, s_a, s_y, II11, II12, II22) (theory §2).

        One solve per component with one factorisation. Units follow ``stress``; valid at every equilibrium.
        """
        return response(self.energy(state.strain), state).moduli

    @checked
    def sensitivities(self, state: Equilibrium) -> Sensitivities:
        """Derivatives of energy density and stress by material parameters and rest lengths, at an equilibrium."""
        return sensitivities(self.energy(state.strain), state)
