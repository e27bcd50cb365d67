"""Conversion between textile units and SI."""

from __future__ import annotations

import math

from yarnscale.errors import InputError, positive
from yarnscale.kinematics import GRAM_FORCE, INCH

FACTORS = {
    # linear density [kg/m]
    "kg/m": ("linear density", 1.0),
    "tex": ("linear density", 1e-6),
    "dtex": ("linear density", 1e-7),
    "denier": ("linear density", 1e-3 / 9000.0),
    # force [N]
    "N": ("force", 1.0),
    "cN": ("force", 1e-2),
    "mN": ("force", 1e-3),
    "gf": ("force", GRAM_FORCE),
    # force per width [N/m]
    "N/m": ("line load", 1.0),
    "N/mm": ("line load", 1e3),
    "N/cm": ("line load", 1e2),
    # length [m]
    "m": ("length", 1.0),
    "cm": ("length", 1e-2),
    "mm": ("length", 1e-3),
    "um": ("length", 1e-6),
    "inch": ("length", INCH),
    # pressure [Pa]
    "Pa": ("pressure", 1.0),
    "kPa": ("pressure", 1e3),
    "MPa": ("pressure", 1e6),
    "GPa": ("pressure", 1e9),
    # mass per volume and per area
    "kg/m3": ("density", 1.0),
    "g/cm3": ("density", 1e3),
    "kg/m2": ("area density", 1.0),
    "g/m2": ("area density", 1e-3),
    # bending stiffness [N m²]
    "N m2": ("bending stiffness", 1.0),
    "N mm2": ("bending stiffness", 1e-6),
    "cN cm2": ("bending stiffness", 1e-6),
}
"""Unit -> (quantity, size in SI units)."""

COUNTS = {
    # Hanks of 840 yards to the pound; metres to the gram.
    "Ne": 0.45359237 / (840.0 * 0.9144),
    "Nm": 1e-3,
}
"""Yarn counts -> linear density [kg/m] of count 1; a finer yarn has the larger count."""


def to_si(value: float, unit: str) -> float:
    """A value in a unit of `FACTORS` or a count of `COUNTS`, in SI units (counts: [kg/m]).

    Raises InputError for an unknown unit or a count that is not positive.
    """
    if unit in COUNTS:
        return COUNTS[unit] / positive(f"yarn count {unit}", value)
    if unit not in FACTORS:
        raise InputError("unknown unit", expected=", ".join([*FACTORS, *COUNTS]), found=repr(unit))
    return value * FACTORS[unit][1]


def yarn_radius(linear_density: float, *, fibre_density: float, packing_fraction: float = 0.5) -> float:
    """Radius [m] of a round yarn of `linear_density` [kg/m] made of fibres of `fibre_density` [kg/m³].

    The packing fraction is the share of the yarn's cross-section that fibres fill: about 0.5 to 0.6 for
    firmly spun yarns, 0.1 to 0.3 for soft knitting yarns.
    """
    density = yarn_density(fibre_density=fibre_density, packing_fraction=packing_fraction)
    return math.sqrt(positive("linear density", linear_density) / (math.pi * density))


def yarn_density(*, fibre_density: float, packing_fraction: float = 0.5) -> float:
    """Mass per volume of a yarn [kg/m³], the air between its fibres included."""
    if not 0.0 < packing_fraction <= 1.0:
        raise InputError("packing_fraction is no share", expected="0 to 1", found=packing_fraction)
    return positive("fibre_density", fibre_density) * packing_fraction


def linear_density(radius: float, density: float) -> float:
    """Mass per length [kg/m] of a yarn of `radius` [m] and `density` [kg/m³]."""
    return math.pi * positive("radius", radius) ** 2 * positive("density", density)
