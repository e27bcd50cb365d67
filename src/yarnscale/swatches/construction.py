"""What a textile engineer counts and weighs on the estimated fabric at rest."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from yarnscale.cell.periodic import PeriodicCell
from yarnscale.errors import InputError, positive

Stitches = tuple[int, int]
"""Wales and courses of one period."""


@dataclass(frozen=True)
class YarnComposition:
    """One yarn of a fabric (EST22 §4.1).

    denier: grams per 9000 m of unstretched yarn. filaments: their number. mass_share: of the fabric's mass, in (0, 1].
    stiffness: force per strain as measured at 5 cN [N], None where unknown. density: of the yarn's material [kg/m³].
    coating: any finish of its fibres. bending_stiffness: of the yarn as measured [N m²], None where unknown.
    """

    material: str
    denier: float
    filaments: int = 1
    mass_share: float = 1.0
    stiffness: float | None = None
    density: float | None = None
    coating: str = ""
    bending_stiffness: float | None = None

    def __post_init__(self) -> None:
        where = f"yarn '{self.material}'"
        for name in ("denier", "filaments", "mass_share", "stiffness", "density", "bending_stiffness"):
            if getattr(self, name) is not None:
                positive(f"{name} of {where}", getattr(self, name))
        if self.mass_share > 1:
            raise InputError(f"mass_share of {where}", expected="at most 1", found=self.mass_share)


@dataclass(frozen=True)
class KnownConstruction:
    """What was counted and weighed on the fabric at rest; None where it was not.

    wales, courses: stitch density [1/m]; loop_length: yarn in one stitch [m]; yarn_count: mass per length of yarn
    [kg/m]; area_density: [kg/m²]. Raises InputError for numbers that are not positive.
    """

    wales: float | None = None
    courses: float | None = None
    loop_length: float | None = None
    yarn_count: float | None = None
    area_density: float | None = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value is not None:
                positive(name.replace("_", " "), value)

    @property
    def stitch_area(self) -> float | None:
        """Fabric of one stitch [m²]."""
        return None if self.wales is None or self.courses is None else 1.0 / (self.wales * self.courses)

    @property
    def yarn_in_stitch(self) -> float | None:
        """Loop length as known, or what mass, yarn count and stitch density leave [m]."""
        if self.loop_length is not None:
            return self.loop_length
        if self.stitch_area is None or self.area_density is None or self.yarn_count is None:
            return None
        return self.area_density * self.stitch_area / self.yarn_count


@dataclass(frozen=True)
class FabricConstruction:
    """Construction of a knit or weave at rest.

    wales, courses: stitch density [1/m]; loop_length: yarn in one stitch [m]; None where the stitches of the period are
    unknown. yarn_length: yarn in one period [m]. yarn_count: mass per length of yarn [kg/m]. area_density: [kg/m²].
    thickness: through the yarns of both faces [m].
    """

    wales: float | None
    courses: float | None
    loop_length: float | None
    yarn_length: float
    yarn_count: float
    area_density: float
    thickness: float

    @classmethod
    def of(cls, cell: PeriodicCell, stitches: Stitches | None) -> FabricConstruction:
        """The construction of a cell at rest; stitches: wales and courses of its period, None where not known."""
        pattern, length = cell.pattern, float(cell.pattern.rest_length.sum())
        wales, courses = (None, None) if stitches is None else (stitches / pattern.period).tolist()
        thickness = float(np.ptp(pattern.vertices[:, 2])) + 2.0 * pattern.radius
        return cls(
            wales, courses, None if stitches is None else length / math.prod(stitches), length,
            cell.area_density * float(np.prod(pattern.period)) / length, cell.area_density, thickness,
        )  # fmt: skip

    def summary(self) -> dict[str, float | None]:
        """Numbers in the units of the trade, by name."""
        scaled = {
            "wales_per_cm": (self.wales, 1e-2), "courses_per_cm": (self.courses, 1e-2),
            "loop_length_mm": (self.loop_length, 1e3), "yarn_length_of_period_mm": (self.yarn_length, 1e3),
            "tex": (self.yarn_count, 1e6), "area_density_g_m2": (self.area_density, 1e3),
            "thickness_mm": (self.thickness, 1e3),
        }  # fmt: skip
        return {name: None if value is None else factor * value for name, (value, factor) in scaled.items()}


def sized(cell: PeriodicCell, factor: float) -> PeriodicCell:
    """The same fabric larger by a factor, with yarns that give it the same line loads at the same stretch.

    Forces grow by the factor, so moduli shrink by it: k_s by the factor, k_b by its cube; the contact stiffness stays.
    """
    (material,) = cell.materials
    stretch = replace(material.stretch, stiff_modulus=material.stretch.stiff_modulus / factor)
    scaled = replace(
        material, young_modulus=material.young_modulus / factor, shear_modulus=material.shear_modulus / factor,
        stretch=stretch,
    )  # fmt: skip
    return replace(cell, pattern=cell.pattern.scaled(factor), material=scaled)


def weighed(cell: PeriodicCell, *, area_density: float | None, yarn_count: float | None) -> PeriodicCell:
    """The cell of one yarn material with the density that the measured mass of the fabric or of its yarn calls for.

    Inertia has no part in an equilibrium without gravity, so the density is set after the fit. The mass of the fabric
    counts before that of the yarn. Without either the density stays.
    """
    if area_density is not None:
        factor = area_density / cell.area_density
    elif yarn_count is not None:
        factor = yarn_count / FabricConstruction.of(cell, None).yarn_count
    else:
        return cell
    (material,) = cell.materials
    return replace(cell, material=replace(material, density=material.density * factor))
