"""Units of the textile trade against hand calculations."""

from __future__ import annotations

import math

import pytest

from yarnscale.errors import InputError
from yarnscale.yarn.units import (
    linear_density,
    to_si,
    yarn_density,
    yarn_radius,
)


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (9000.0, "denier", 1e-3),
        (72.0, "denier", 8e-6),
        (1000.0, "tex", 1e-3),
        (10.0, "dtex", 1e-6),
        (1.0, "Nm", 1e-3),
        (40.0, "Nm", 2.5e-5),
        (1.0, "Ne", 590.541e-6),
        (20.0, "Ne", 29.527e-6),
        (100.0, "cN", 1.0),
        (1000.0, "gf", 9.80665),
        (0.083, "N/mm", 83.0),
        (0.045, "N mm2", 4.5e-8),
        (25.4, "mm", 0.0254),
        (1.0, "inch", 0.0254),
    ],
)
def test_units_to_si(value: float, unit: str, expected: float) -> None:
    assert to_si(value, unit) == pytest.approx(expected, rel=1e-5)


def test_radius_from_linear_density() -> None:
    # 30 tex cotton (1.52 g/cm³), 0.55 packed: r² = 3e-5 / (π 1520 0.55).
    radius = yarn_radius(to_si(30, "tex"), fibre_density=1520.0, packing_fraction=0.55)
    assert radius == pytest.approx(math.sqrt(3e-5 / (math.pi * 1520 * 0.55)))
    assert 1.0e-4 < radius < 1.2e-4
    density = yarn_density(fibre_density=1520.0, packing_fraction=0.55)
    assert linear_density(radius, density) == pytest.approx(3e-5)


def test_what_makes_no_sense_is_named() -> None:
    with pytest.raises(InputError, match=r"unknown unit; expected kg/m, tex, .*; found 'stone'"):
        to_si(1.0, "stone")
    with pytest.raises(InputError, match=r"yarn count Ne; expected a positive number"):
        to_si(0.0, "Ne")
    with pytest.raises(InputError, match=r"packing_fraction is no share; expected 0 to 1; found 1.5"):
        yarn_radius(1e-5, fibre_density=1500.0, packing_fraction=1.5)
