"""Pages of the material library: of all materials with their main numbers, and of one with pictures and curves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from yarnscale.cell import PeriodicCell
from yarnscale.drawing import library
from yarnscale.files.material_json import read_material
from yarnscale.files.material_library import LIBRARY, MATERIAL, PATTERN, TESTS, names, tests
from yarnscale.files.patterns import read_pattern, read_yarns
from yarnscale.laboratory.programme import Difference, FabricTests, difference
from yarnscale.show.curves import pattern_curves, rings_for
from yarnscale.show.laboratory import draw_others, draw_tension, numbers_section
from yarnscale.show.report import Cell, Picture, Section, Table, write_report
from yarnscale.show.tubes import yarn_picture

SIZE, SMALL = (480, 480), (240, 240)
LOADS = (0.5, 1.0, 5.0, 20.0, 50.0)
"""Loads of the table of a material [N/m]."""
LOAD = 5.0
"""Load of the table of all materials [N/m]."""
POOR_STRESS, POOR_STRETCH, POOR_BENDING = 0.1, 0.9, 0.2
"""A fit is called poor where the median error of the stress is larger, a smaller share of the tension points agrees, or
a bending rigidity is further off."""
COLUMNS = (
    "material", "weight [g/m²]", "stretch, course [%]", "bias [%]", "wale [%]", "contraction, course [%]", "wale [%]",
    "B, course [µN·m]", "wale [µN·m]", "curl, course [1/m]", "wale [1/m]", "error of the fit [%]",
)  # fmt: skip
CAPTION = (
    f"Cells of yarns: stretch and contraction at {LOAD:g} N/m along course, bias and wale; B: bending rigidity; curl: "
    "natural curvature. Error: of the stress of the shell material at unseen states, median."
)


@dataclass(frozen=True, eq=False)
class LibraryMaterial:
    """A material of a library folder, by its name, with its tests: of the cell of yarns and of the shell."""

    name: str
    folder: Path = LIBRARY

    @cached_property
    def tested(self) -> tuple[FabricTests, FabricTests]:
        """Tests of the cell and of the shell."""
        return tests(self.name, self.folder)

    @cached_property
    def provenance(self) -> Mapping[str, Any]:
        """Of the shell material."""
        return read_material(self.folder / self.name / MATERIAL).provenance

    @cached_property
    def difference(self) -> Difference:
        """Of the shell from the cell in tension."""
        cell, shell = self.tested
        return difference(shell.tension, cell.tension)

    @property
    def stress_error(self) -> Mapping[str, float]:
        """Errors of the stress at unseen states: ``states``, ``median``, ``high`` (95th percentile), ``mean``."""
        return self.provenance.get("unseen", {"states": 0, "median": float("nan"), "high": float("nan")})

    @property
    def bending_error(self) -> float:
        """Largest relative difference of the shell's bending rigidities from the cell's."""
        pairs = zip(*(fabric.bend for fabric in self.tested), strict=True)
        return max((abs(shell.B / cell.B - 1.0) for cell, shell in pairs if cell.B and shell.B), default=float("nan"))

    @property
    def poor(self) -> bool:
        """Whether the shell is far from the yarns."""
        return (
            not self.stress_error["median"] <= POOR_STRESS
            or self.difference.stretch_within < POOR_STRETCH
            or self.bending_error > POOR_BENDING
        )

    def remarks(self) -> list[str]:
        """What is known of the fit and of the tests."""
        error, apart, (cell, shell) = self.stress_error, self.difference, self.tested
        found = [
            f"{'Poor fit' if self.poor else 'Fit'}: the stress at {error['states']} unseen states is off by "
            f"{100 * error['median']:.2g} % of its own size in the median and by {100 * error['high']:.2g} % at the"
            " 95th percentile.",
            f"{100 * apart.stretch_within:.3g} % of {apart.points} tension points agree with the yarns within 0.01 + 3"
            f" % of stretch (largest difference {apart.stretch:.2g}); bending rigidities are within "
            f"{100 * self.bending_error:.2g} %.",
        ]
        for fabric, what in ((cell, "cell of yarns"), (shell, "shell material")):
            if fabric.failed:
                found.append(f"{fabric.failed} points of the tests of the {what} have no equilibrium.")
        return found

    def origin(self) -> str:
        """Where it comes from."""
        known, made = self.provenance, self.provenance.get("made", {})
        yarn = known["material"] if isinstance(known["material"], Mapping) else known["material"][0]
        numbers = ", ".join(
            f"{label} {yarn[key]:.4g}{unit}"
            for key, label, unit in (
                ("young_modulus", "E", " Pa"), ("shear_modulus", "G", " Pa"), ("bending_scale", "bending scale", ""),
                ("contact_stiffness", "contact stiffness", " kg/s²"), ("density", "density", " kg/m³"),
            )
        )  # fmt: skip
        return (
            f"Yarn {yarn['name']}: {numbers}, radius {1e3 * known['radius']:.3g} mm. Made with yarnscale "
            f"{known['versions']['yarnscale']}{', commit ' * bool(made.get('commit'))}{made.get('commit', '')}"
            f"{', ' * bool(made)}{made.get('date', '')}: {known['fit']['states']} states, seed {known['seed']}."
        )

    def row(self) -> list[Cell]:
        """Cells of ``COLUMNS``."""
        cell = self.tested[0]
        pulled = {(p.direction, p.load): p for p in cell.tension if p.status == "converged"}
        at = [pulled.get((direction, LOAD)) for direction in (0.0, 45.0, 90.0)]
        rigidity = {s.direction: s.B for s in cell.bend}
        return [
            self.name + " (poor fit)" * self.poor, 1e3 * cell.density,
            *(None if p is None else 100 * p.stretch for p in at),
            *(None if p is None else 100 * p.contraction for p in (at[0], at[2])),
            *(None if (b := rigidity.get(d)) is None else 1e6 * b for d in (0.0, 90.0)),
            *(r.curvature if r.status == "converged" else None for r in cell.rolls), 100 * self.stress_error["median"],
        ]  # fmt: skip

    def draw_yarns(self, path: Path, size: tuple[int, int] = SIZE) -> Picture:
        """The fabric at rest from its face."""
        place = self.folder / self.name / PATTERN
        pattern, yarns = read_pattern(place), read_yarns(place)
        assert yarns is not None
        rings = rings_for(pattern.period, pattern.radius)
        curves = pattern_curves(pattern, PeriodicCell(pattern, yarns).placement(None), rings=rings)
        yarn_picture(path, curves, pattern.radius, camera="top", size=size)
        return Picture(path, "The fabric at rest, course to the right.")

    def sections(self, pictures: Path) -> list[Section]:
        """What its page says: pictures, which are drawn into a folder, and all numbers of yarns and shell."""
        draw_tension(pictures / f"{self.name}-tension.png", self.tested)
        draw_others(pictures / f"{self.name}-bending.png", self.tested)
        curves = "Full lines and dots: yarns; dashed lines and crosses: shell material."
        drawn = [
            self.draw_yarns(pictures / f"{self.name}.png"),
            Picture(pictures / f"{self.name}-tension.png", f"Tension by direction of pull. {curves}", wide=True),
            Picture(pictures / f"{self.name}-bending.png", f"Bending, twist and shear. {curves}", wide=True),
        ]
        first = Section("Fabric", self.sentences(), [self._tension()], drawn)
        return [first, *(numbers_section(fabric) for fabric in self.tested)]

    def sentences(self) -> list[str]:
        """The structure, the origin, and what is known of the fit."""
        known = library.STRUCTURES.get(str(self.provenance["pattern"]))
        return [*([known.definition] if known else []), self.origin(), *self.remarks()]

    def _tension(self) -> Table:
        known = [{(p.direction, p.load): p for p in fabric.tension} for fabric in self.tested]
        places = [(d, load) for d in self.tested[0].directions for load in LOADS if all((d, load) in k for k in known)]
        quantities = ("stretch", "contraction")
        rows = [[*place, *(100 * getattr(k[place], name) for name in quantities for k in known)] for place in places]
        columns = [f"{name}, {of} [%]" for name in quantities for of in ("yarns", "shell")]
        return Table(["direction [°]", "load [N/m]", *columns], rows, "Tension, flat, free across.")


def write_library(folder: Path) -> list[str]:
    """Write ``index.html`` of all materials of a library folder that were tested; their names."""
    shown = [LibraryMaterial(name, folder) for name in names(folder) if (folder / name / TESTS).is_file()]
    sections = []
    for one in shown:
        picture = one.draw_yarns(folder / one.name / "yarns.png", SMALL)
        sections.append(Section(one.name, one.sentences(), [], [picture]))
    table = Section("All materials", [], [Table(COLUMNS, [one.row() for one in shown], CAPTION)])
    write_report(folder / "index.html", "Material library", [table, *sections], facts={"materials": len(shown)})
    return [one.name for one in shown]
