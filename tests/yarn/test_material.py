"""Yarn materials and the contact rule."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from yarnscale.errors import InputError
from yarnscale.yarn.material import ContactRule, StretchRule, YarnMaterial

# HYLC20 Table 1: E [Pa], G [Pa], γ, k_contact [kg/s²], ρ [kg/m³].
TABLE_1 = {
    "basket": (1e5, 4e4, 0.1, 1.2e1, 1.2e2),
    "honeycomb": (5e5, 2e5, 0.1, 6e1, 1.2e2),
    "rib": (5e5, 2e5, 0.001, 6e1, 6e1),
    "satin": (1e5, 4e4, 0.1, 1.2e1, 1.2e2),
    "stockinette": (5e5, 2e5, 0.001, 6e1, 1.2e2),
    "satin-small": (1e6, 4e5, 1.0, 1e2, 1.2e3),
    "stockinette-small": (1e6, 4e5, 1.0, 1e2, 1.2e3),
}


@pytest.mark.parametrize("name", TABLE_1)
def test_presets_are_the_published_columns(name: str) -> None:
    material = YarnMaterial.preset(f"hylc2020-{name}")
    assert (
        material.young_modulus,
        material.shear_modulus,
        material.bending_scale,
        material.contact_stiffness,
        material.density,
    ) == TABLE_1[name]
    assert material.contact == ContactRule(neighbours=4 if name == "satin-small" else 3)
    assert material.name == f"hylc2020-{name}"


def test_everyday_presets_are_materials() -> None:
    for name in ("wool", "cotton", "acrylic"):
        material = YarnMaterial.preset(name)
        assert 3e-8 <= material.bending_stiffness(1e-3) <= 7e-8
        assert sum(material.contact.quadrature_weights) == pytest.approx(1.0)
    # The measured bending stiffness of the acrylic yarn: 0.045 N mm².
    assert YarnMaterial.preset("acrylic").bending_stiffness(1e-3) == pytest.approx(4.5e-8, rel=0.05)


def test_unknown_preset_lists_the_names() -> None:
    with pytest.raises(InputError, match=r"unknown material preset; expected hylc2020-stockinette, .*; found 'silk'"):
        YarnMaterial.preset("silk")


def test_stiffnesses_of_a_round_rod() -> None:
    material = YarnMaterial(2e6, 8e5, 0.5, 10.0, 100.0)
    r = 2e-3
    assert material.stretch_stiffness(r) == pytest.approx(2e6 * math.pi * r**2)
    assert material.bending_stiffness(r) == pytest.approx(0.5 * 2e6 * math.pi * r**4 / 4)
    assert material.twist_stiffness(r) == pytest.approx(0.5 * 8e5 * math.pi * r**4 / 2)
    assert material.mass_per_length(r) == pytest.approx(100.0 * math.pi * r**2)


def test_published_weights_sum_to_four_fifths() -> None:
    rule = ContactRule()
    assert rule.quadrature_points == (0.0, 0.25, 0.5, 0.75, 1.0)
    assert rule.quadrature_weights == pytest.approx(np.array([1, 4, 2, 4, 1]) / 15)
    assert sum(rule.quadrature_weights) == pytest.approx(0.8)


@pytest.mark.parametrize("points", [3, 5, 7, 9])
def test_simpson_weights_integrate_cubics(points: int) -> None:
    rule = ContactRule(points=points, weights="simpson")
    s, w = np.array(rule.quadrature_points), np.array(rule.quadrature_weights)
    for power in range(4):
        assert (w * s**power).sum() == pytest.approx(1.0 / (power + 1))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"young_modulus": -1.0}, "young_modulus must be positive; expected > 0; found -1.0"),
        ({"young_modulus": 0.0}, "young_modulus must be positive"),
        ({"shear_modulus": float("nan")}, "shear_modulus must be zero or more; expected ≥ 0; found nan"),
        ({"density": "heavy"}, "density must be a number; expected a number; found 'heavy'"),
        ({"bending_scale": True}, "bending_scale must be a number"),
        ({"contact_stiffness": 10**400}, "contact_stiffness must be positive"),
        ({"name": 3}, "name must be text"),
        ({"contact": None}, "contact must be a contact rule"),
        ({"stretch": "two_phase"}, "stretch must be a stretch rule"),
    ],
)
def test_impossible_materials_are_named(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        replace(YarnMaterial.preset("wool"), **change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kernel": "magic"}, "contact.kernel is unknown; expected hylc2020 or est2022; found magic"),
        ({"weights": "gauss"}, "contact.weights is unknown"),
        ({"points": 4}, "contact.points must be odd"),
        ({"points": 1}, "contact.points is out of range"),
        ({"points": 5.0}, "contact.points must be an integer"),
        ({"neighbours": 0}, "contact.neighbours is out of range"),
        ({"inner_radius_ratio": -0.25}, "contact.inner_radius_ratio must be positive"),
    ],
)
def test_impossible_contact_rules_are_named(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        ContactRule(**change)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"law": "cubic"}, "stretch.law is unknown; expected linear or two_phase; found cubic"),
        ({"law": "two_phase"}, "stretch.stiff_modulus must be positive"),
        ({"law": "two_phase", "stiff_modulus": 1e6, "knee": -0.1}, "stretch.knee must be zero or more"),
    ],
)
def test_impossible_stretch_rules_are_named(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        StretchRule(**change)  # type: ignore[arg-type]


def test_stiffnesses_are_set_one_by_one() -> None:
    material, r = YarnMaterial(2e6, 8e5, 0.5, 10.0, 100.0), 2e-3
    before = (material.stretch_stiffness(r), material.bending_stiffness(r), material.twist_stiffness(r))
    for k, name in enumerate(("stretch", "bending", "twist")):
        changed = material.with_stiffnesses(r, **{name: 3.0 * before[k]})
        after = (changed.stretch_stiffness(r), changed.bending_stiffness(r), changed.twist_stiffness(r))
        assert after == pytest.approx([3.0 * b if i == k else b for i, b in enumerate(before)], rel=1e-12)
    limp = material.with_stiffnesses(r, bending=0.0, twist=0.0)
    assert limp.bending_stiffness(r) == limp.twist_stiffness(r) == 0.0
    with pytest.raises(InputError, match="twist stiffness without bending stiffness"):
        material.with_stiffnesses(r, bending=0.0)
    with pytest.raises(InputError, match="stretch stiffness must be positive"):
        material.with_stiffnesses(r, stretch=0.0)


def test_the_stiff_phase_has_its_own_modulus() -> None:
    linear, r = YarnMaterial(2e6, 8e5, 0.5, 10.0, 100.0), 2e-3
    two_phase = replace(linear, stretch=StretchRule("two_phase", knee=0.1, stiff_modulus=3e7))
    assert linear.stiff_stretch_stiffness(r) == linear.stretch_stiffness(r) == two_phase.stretch_stiffness(r)
    assert two_phase.stiff_stretch_stiffness(r) == pytest.approx(3e7 * math.pi * r**2)


def test_numpy_numbers_are_numbers() -> None:
    material = replace(YarnMaterial.preset("wool"), density=np.float32(2.0), young_modulus=np.array(3))
    assert (material.density, material.young_modulus) == (2.0, 3.0)
    assert type(material.young_modulus) is float
