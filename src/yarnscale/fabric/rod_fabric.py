"""Finite fabrics of elastic rods made from a pattern: cut with glued borders, closed to a tube, or knitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from yarnscale.cell.periodic import PeriodicCell
from yarnscale.checked import checked
from yarnscale.drawing.stitches import StitchChart
from yarnscale.fabric.boundary import BorderSprings, glue
from yarnscale.fabric.direct_energy import FabricEnergy
from yarnscale.fabric.direct_static import relaxed_sheet
from yarnscale.fabric.knitted_sheet import knitted_sheet, woven_in
from yarnscale.fabric.sheet import YarnSheet
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.stiffness import Materials, materials_of


@dataclass(frozen=True, eq=False)
class RodFabric:
    """A sheet of yarns, their materials, and the springs at its borders.

    material: one for all yarns, or one for each number in the pattern.
    """

    sheet: YarnSheet
    material: Materials
    borders: BorderSprings = field(default_factory=BorderSprings.none)

    @classmethod
    @checked
    def cut(
        cls, pattern: YarnPattern, material: Materials, columns: int, rows: int, *, relax: bool = True
    ) -> RodFabric:
        """``columns`` by ``rows`` periods cut from endless fabric, with glued borders (``glue``).

        relax: loops have the shape of the relaxed periodic cell, else that of the pattern. Raises InputError.
        """
        sheet = YarnSheet.of(pattern, columns, rows)
        if relax:
            cell = PeriodicCell(pattern, material)
            state = cell.relax()
            places = cell.placement(state)(sheet.source, sheet.tile)
            sheet = sheet.moved(places, twist=state.twist[sheet.source])
        return cls(sheet, material, glue(sheet, materials_of(pattern, material)[0]))

    @classmethod
    @checked
    def tube(
        cls, pattern: YarnPattern, material: Materials, columns: int, rows: int, *, relax: bool = True
    ) -> RodFabric:
        """``columns`` periods around and ``rows`` along a tube about the y axis, glued at both open ends.

        relax: some Newton iterations towards rest (``relaxed_sheet``). Raises InputError.
        """
        sheet = YarnSheet.of(pattern, columns, rows, tube=True)
        along = sheet.vertices[:, 1]
        normals = sheet.vertices * [1.0, 0.0, 1.0]
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        ends = np.minimum(along - along.min(), along.max() - along)
        springs = glue(sheet, materials_of(pattern, material)[0], distance=ends, normals=normals)
        return cls(sheet, material, springs)._relaxed(relax)

    @classmethod
    @checked
    def knitted(
        cls,
        pattern: YarnPattern,
        material: Materials,
        columns: int,
        rows: int,
        *,
        chart: StitchChart | Sequence[str] | str | None = None,
        relax: bool = True,
    ) -> RodFabric:
        """A piece with cast-on, selvedges and bind-off (``knitted_sheet``), the ends of its yarns woven in.

        relax: some Newton iterations towards rest (``relaxed_sheet``). Raises InputError.
        """
        sheet = knitted_sheet(pattern, columns, rows, chart=chart)
        return cls(sheet, material, woven_in(sheet, materials_of(pattern, material)[0]))._relaxed(relax)

    def _relaxed(self, relax: bool) -> RodFabric:
        return replace(self, sheet=relaxed_sheet(self.energy())) if relax else self

    def energy(self) -> FabricEnergy:
        """The energy of the fabric."""
        return FabricEnergy(self.sheet, self.material, springs=self.borders)
