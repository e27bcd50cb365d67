"""Yarn materials: stiffnesses, contact and density (HYLC20 §5.1 and Table 1, EST22 §6)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from numbers import Real

from yarnscale.errors import InputError, misspelt

KERNELS = ("hylc2020", "est2022")
WEIGHTS = ("published", "simpson")
LAWS = ("linear", "two_phase")
LARGEST_RATIO = 10
"""Of the reach of contact to the yarn's radius."""
SMALLEST, LARGEST = 1e-12, 1e18
"""Sizes of numbers other than 0 that a yarn can have, in SI units."""


@dataclass(frozen=True)
class ContactRule:
    """Law and quadrature of the contact energy of two segments; the defaults are the published convention.

    kernel: ``"hylc2020"``, f(d) = 1/d² + d² - 2 for d = D/2r < 1 (HYLC20 §5.1, after Kaldor 2008), or
        ``"est2022"``, two barriers -(x-1)² ln x with x = (D/2R)² (EST22 eq. 7).
    points: quadrature points along each segment, an odd number from 3.
    weights: ``"published"``, (1, 4, 2, …, 4, 1) / (3 points), sum 0.8 for 5 points, as in the published energies;
        ``"simpson"``, the normalised rule.
    neighbours: of published patterns (polylines): segments of one yarn at most this many edges apart do not touch (3;
        ``satin-small`` has 4). Smooth yarns go by arc length instead (``strands.Neighbours``).
    outer_radius_ratio, inner_radius_ratio: R₁ and R₂ of ``est2022`` over the yarn radius [-].
    inner_stiffness: stiffness k_c2 of the inner barrier of ``est2022`` [kg/s²]; the outer one, k_c1, is the
        material's ``contact_stiffness``.
    friction: coefficient μ where it is known, for what takes friction from the yarn; the energy has none.
    """

    kernel: str = "hylc2020"
    points: int = 5
    weights: str = "published"
    neighbours: int = 3
    outer_radius_ratio: float = 1.0
    inner_radius_ratio: float = 0.25
    inner_stiffness: float = 1e3
    friction: float | None = None

    def __post_init__(self) -> None:
        """Check every field."""
        if self.kernel not in KERNELS:
            raise InputError("contact.kernel is unknown", expected=" or ".join(KERNELS), found=self.kernel)
        if self.weights not in WEIGHTS:
            raise InputError("contact.weights is unknown", expected=" or ".join(WEIGHTS), found=self.weights)
        _integer("contact.points", self.points, 3, 99)
        if self.points % 2 == 0:
            raise InputError("contact.points must be odd", expected="3, 5, 7, …", found=self.points)
        _integer("contact.neighbours", self.neighbours, 1, 1000)
        for name in ("outer_radius_ratio", "inner_radius_ratio", "inner_stiffness"):
            object.__setattr__(self, name, _number(f"contact.{name}", getattr(self, name), positive=True))
            if name.endswith("ratio") and getattr(self, name) > LARGEST_RATIO:
                raise InputError(
                    f"contact.{name} is too large", expected=f"≤ {LARGEST_RATIO}", found=getattr(self, name)
                )
        if self.friction is not None:
            object.__setattr__(self, "friction", _number("contact.friction", self.friction, positive=False))

    @property
    def quadrature_points(self) -> tuple[float, ...]:
        """Positions on a segment, from 0 to 1."""
        return tuple(i / (self.points - 1) for i in range(self.points))

    @property
    def quadrature_weights(self) -> tuple[float, ...]:
        """Weights of the positions; they sum to 1 (``simpson``) or to (points - 1)/points (``published``)."""
        divisor = 3 * (self.points if self.weights == "published" else self.points - 1)
        last = self.points - 1
        pattern = [1 if i in (0, last) else 4 if i % 2 else 2 for i in range(self.points)]
        return tuple(weight / divisor for weight in pattern)


@dataclass(frozen=True)
class StretchRule:
    """Law of the tension of a yarn over its strain.

    law: ``"linear"``, k_s in tension and compression (HYLC20 §5.1), or ``"two_phase"``, k_s1 from rest to the
        strain `knee`, k_s2 beyond it and in compression (EST22 eq. 5). k_s1 belongs to the material's
        ``young_modulus``, which also scales bending; k_s2 has no influence on bending.
    knee: ε̄ of ``two_phase`` [-].
    stiff_modulus: modulus E₂ of ``two_phase`` [Pa]; k_s2 = E₂ π r².
    """

    law: str = "linear"
    knee: float = 0.0
    stiff_modulus: float = 0.0

    def __post_init__(self) -> None:
        """Check every field."""
        if self.law not in LAWS:
            raise InputError("stretch.law is unknown", expected=" or ".join(LAWS), found=self.law)
        two_phase = self.law == "two_phase"
        object.__setattr__(self, "knee", _number("stretch.knee", self.knee, positive=False))
        stiff = _number("stretch.stiff_modulus", self.stiff_modulus, positive=two_phase)
        object.__setattr__(self, "stiff_modulus", stiff)


@dataclass(frozen=True)
class YarnMaterial:
    """The material of a yarn as a discrete elastic rod with contact.

    young_modulus: E [Pa]; stretch stiffness k_s = E π r², or k_s1 with the law ``two_phase``.
    shear_modulus: G [Pa]; twist stiffness k_t = γ G π r⁴/2.
    bending_scale: γ [-], scales bending and twist (HYLC20 eq. 23); bending stiffness k_b = γ E π r⁴/4.
    contact_stiffness: k_contact, or k_c1 with the kernel ``est2022`` [kg/s²].
    density: mass per volume of the yarn, air included [kg/m³].
    name: a label.
    contact: law and quadrature of contact.
    stretch: law of tension.

    Raises InputError with the field for impossible values.
    """

    young_modulus: float
    shear_modulus: float
    bending_scale: float
    contact_stiffness: float
    density: float
    name: str = "yarn"
    contact: ContactRule = field(default_factory=ContactRule)
    stretch: StretchRule = field(default_factory=StretchRule)

    def __post_init__(self) -> None:
        """Check every field."""
        for name in NUMBERS:
            positive = name in ("young_modulus", "contact_stiffness", "density")
            object.__setattr__(self, name, _number(name, getattr(self, name), positive=positive))
        if not isinstance(self.name, str):
            raise InputError("name must be text", expected="a string", found=repr(self.name))
        if not isinstance(self.contact, ContactRule):
            raise InputError("contact must be a contact rule", expected="ContactRule", found=repr(self.contact))
        if not isinstance(self.stretch, StretchRule):
            raise InputError("stretch must be a stretch rule", expected="StretchRule", found=repr(self.stretch))

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={getattr(self, name):.4g}" for name in NUMBERS)
        rules = "".join(f", {rule}" for rule in (self.contact.kernel, self.stretch.law) if rule != "linear")
        return f"YarnMaterial('{self.name}', {values}{rules})"

    def stretch_stiffness(self, radius: float) -> float:
        """Force per relative stretch k_s = E π r² [N] of a yarn of `radius` [m]; k_s1 of a two-phase one."""
        return self.young_modulus * math.pi * radius**2

    def stiff_stretch_stiffness(self, radius: float) -> float:
        """Force per relative stretch in compression and beyond the knee, k_s2 [N]; k_s of a linear yarn."""
        two_phase = self.stretch.law == "two_phase"
        return (self.stretch.stiff_modulus if two_phase else self.young_modulus) * math.pi * radius**2

    def bending_stiffness(self, radius: float) -> float:
        """Moment per curvature k_b = γ E π r⁴/4 [N m²] of a yarn of `radius` [m]."""
        return self.bending_scale * self.young_modulus * math.pi * radius**4 / 4.0

    def twist_stiffness(self, radius: float) -> float:
        """Moment per twist k_t = γ G π r⁴/2 [N m²] of a yarn of `radius` [m]."""
        return self.bending_scale * self.shear_modulus * math.pi * radius**4 / 2.0

    def mass_per_length(self, radius: float) -> float:
        """Linear density ρ π r² [kg/m] of a yarn of `radius` [m]."""
        return self.density * math.pi * radius**2

    def with_stiffnesses(
        self, radius: float, *, stretch: float | None = None, bending: float | None = None, twist: float | None = None
    ) -> YarnMaterial:
        """The material whose yarn of `radius` [m] has these k_s (k_s1) [N], k_b and k_t [N m²]; the others stay.

        Raises InputError for a stretch stiffness of 0, and for twist stiffness without bending stiffness, which the
        common scale γ cannot express.
        """
        section = math.pi * radius**2
        young = (
            self.young_modulus if stretch is None else _number("stretch stiffness", stretch, positive=True) / section
        )
        k_b = (
            self.bending_stiffness(radius) if bending is None else _number("bending stiffness", bending, positive=False)
        )
        k_t = self.twist_stiffness(radius) if twist is None else _number("twist stiffness", twist, positive=False)
        scale = 4.0 * k_b / (young * section * radius**2)
        if scale == 0.0:
            if k_t != 0.0:
                raise InputError("twist stiffness without bending stiffness", expected="0", found=k_t)
            return replace(self, young_modulus=young, bending_scale=0.0)
        shear = 2.0 * k_t / (scale * section * radius**2)
        return replace(self, young_modulus=young, shear_modulus=shear, bending_scale=scale)

    @classmethod
    def preset(cls, name: str) -> YarnMaterial:
        """A named material, see `PRESETS`; InputError listing the names for any other."""
        if name not in PRESETS:
            raise InputError("unknown material preset", expected=", ".join(PRESETS), found=misspelt(name, PRESETS))
        return PRESETS[name]


NUMBERS = ("young_modulus", "shear_modulus", "bending_scale", "contact_stiffness", "density")
"""Fields of `YarnMaterial` that hold numbers."""
CONTACT_FIELDS = tuple(entry.name for entry in fields(ContactRule))
STRETCH_FIELDS = tuple(entry.name for entry in fields(StretchRule))


def _number(field_name: str, value: object, *, positive: bool) -> float:
    if getattr(value, "ndim", None) == 0:
        value = value.item()  # type: ignore[attr-defined]  # of NumPy, as files of arrays hold single numbers
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputError(f"{field_name} must be a number", expected="a number", found=repr(value))
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number) or number < 0.0 or (positive and number == 0.0):
        kind = "positive" if positive else "zero or more"
        raise InputError(f"{field_name} must be {kind}", expected="> 0" if positive else "≥ 0", found=number)
    if number != 0.0 and not SMALLEST <= number <= LARGEST:
        raise InputError(
            f"{field_name} is of no size that yarns have", expected=f"{SMALLEST:g} to {LARGEST:g}", found=number
        )
    return number


def _integer(field_name: str, value: object, least: int, most: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int):
        raise InputError(f"{field_name} must be an integer", expected="an integer", found=repr(value))
    if not least <= value <= most:
        raise InputError(f"{field_name} is out of range", expected=f"{least} to {most}", found=value)


def _published(name: str, young: float, shear: float, scale: float, contact: float, density: float) -> YarnMaterial:
    """One column of HYLC20 Table 1, with the contact convention of the published energies."""
    neighbours = 4 if name == "satin-small" else 3
    rule = ContactRule(neighbours=neighbours)
    return YarnMaterial(young, shear, scale, contact, density, name=f"hylc2020-{name}", contact=rule)


_SIMPSON = ContactRule(weights="simpson")

PRESETS: dict[str, YarnMaterial] = {
    material.name: material
    for material in (
        _published("stockinette", 5e5, 2e5, 0.001, 60.0, 120.0),
        _published("rib", 5e5, 2e5, 0.001, 60.0, 60.0),
        _published("honeycomb", 5e5, 2e5, 0.1, 60.0, 120.0),
        _published("basket", 1e5, 4e4, 0.1, 12.0, 120.0),
        _published("satin", 1e5, 4e4, 0.1, 12.0, 120.0),
        _published("satin-small", 1e6, 4e5, 1.0, 100.0, 1200.0),
        _published("stockinette-small", 1e6, 4e5, 1.0, 100.0, 1200.0),
        YarnMaterial(1e7, 4e6, 4e-3, 60.0, 140.0, name="wool", contact=_SIMPSON),
        YarnMaterial(5e7, 2e7, 1.5e-3, 100.0, 180.0, name="cotton", contact=_SIMPSON),
        YarnMaterial(2e7, 8e6, 2.9e-3, 60.0, 130.0, name="acrylic", contact=_SIMPSON),
    )
}
"""Materials by name.

``hylc2020-…``: the columns of HYLC20 Table 1, for yarns of 1 mm radius (``-small``: 0.1 mm).

``wool``, ``cotton``, ``acrylic``: soft hand-knitting yarns of about 400 to 550 tex and a visible radius of
about 1 mm, as effective rods. Only the bending stiffness of ``acrylic`` is tied to a measurement (4.5e-8 N m²
= 0.045 N mm² at r = 1 mm: the acrylic yarn of Singal et al., Programming mechanics in knitted materials,
2024). The rest are our estimates, right to an order of magnitude: the densities follow from linear densities
of common yarns; stretch stiffnesses of 30 to 160 N stand for the low-load modulus of bulky spun yarns, far
below that of their fibres; wool bends more softly and cotton more stiffly than acrylic; G = 0.4 E and the
contact stiffness follow the published stockinette. Replace them by measured values where it matters.
"""
