"""The macroscopic state of cloth: ``(s_x, s_a, s_y, II)`` and its fundamental forms (HYLC20 eq. 30)."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, fields

import numpy as np

from yarnscale.arrays import Array
from yarnscale.checked import checked
from yarnscale.errors import InputError

COMPONENTS = ("s_x", "s_a", "s_y", "II11", "II12", "II22")
"""Order of strain vectors and of stress; stress is d(energy density) by each of them."""
LARGEST = 1e6
"""No strain [-] or curvature [1/m] exceeds this."""
GRAVITY = 9.81
"""Acceleration of free fall [m/s²]."""
INCH, GRAM_FORCE = 0.0254, 9.80665e-3
"""An inch [m], and the weight of a gram [N]."""


def strain_units(radius: float) -> Array:
    """Strains of like importance for fabric of a yarn radius [m], (6,): a half; a tenth of its curvature."""
    return np.array([0.5] * 3 + [0.1 / radius] * 3)


@checked
@dataclass(frozen=True)
class ShellStrain:
    """Strain of a thin shell: stretches, shear and second fundamental form.

    s_x, s_y: stretch along course (weft) and wale (warp), √I11 − 1 and √I22 − 1 [-].
    s_a: sine of the shear angle, I12 / √(I11 I22) [-].
    II11, II12, II22: curvature tensor [1/m]; z = +x²/2 with normal +z has II11 = +1.

    Raises InputError where no surface has the state: s ≤ −1, |s_a| ≥ 1 or a value beyond ``LARGEST``.
    """

    s_x: float = 0.0
    s_a: float = 0.0
    s_y: float = 0.0
    II11: float = 0.0
    II12: float = 0.0
    II22: float = 0.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = float(getattr(self, field.name))
            if not abs(value) <= LARGEST:
                raise InputError(
                    f"strain {field.name}",
                    expected=f"a finite number, at most {LARGEST:g} in size",
                    found=value,
                )
            object.__setattr__(self, field.name, value)
        for name in ("s_x", "s_y"):
            if getattr(self, name) <= -1.0:
                raise InputError(f"strain {name}", expected="more than -1", found=getattr(self, name))
        if abs(self.s_a) >= 1.0:
            raise InputError("strain s_a", expected="|s_a| < 1 (det I > 0)", found=self.s_a)

    @classmethod
    def from_vector(cls, values: Array | list[float]) -> ShellStrain:
        """State from its six components in the order of ``COMPONENTS``."""
        return cls(*(float(v) for v in values))

    @classmethod
    def from_forms(cls, first: Array, second: Array) -> ShellStrain:
        """State from the fundamental forms I [-] and II [1/m], both (2, 2) and symmetric."""
        determinant = first[0, 0] * first[1, 1] - first[0, 1] ** 2
        if not (first[0, 0] > 0 and first[1, 1] > 0 and determinant > 0):
            raise InputError("first fundamental form", expected="det I > 0", found=f"det I = {determinant:g}")
        a, b = math.sqrt(first[0, 0]), math.sqrt(first[1, 1])
        return cls(a - 1, first[0, 1] / (a * b), b - 1, second[0, 0], second[0, 1], second[1, 1])

    @property
    def vector(self) -> Array:
        """The six components, shape (6,)."""
        return np.array(astuple(self))

    @property
    def first_form(self) -> Array:
        """First fundamental form I [-], shape (2, 2)."""
        a, b = 1 + self.s_x, 1 + self.s_y
        return np.array([[a * a, self.s_a * a * b], [self.s_a * a * b, b * b]])

    @property
    def second_form(self) -> Array:
        """Second fundamental form II [1/m], shape (2, 2)."""
        return np.array([[self.II11, self.II12], [self.II12, self.II22]])

    @property
    def is_flat(self) -> bool:
        """Whether the curvature is exactly zero."""
        return self.II11 == 0.0 and self.II12 == 0.0 and self.II22 == 0.0


def line_stretch(strain: Array, angle: float) -> tuple[float, Array, Array]:
    """Stretch λ = |F u| of the material line that lies along an angle φ [rad] from the course at rest.

    λ² = uᵀ I u = a² c² + 2 s_a a b c s + b² s² with a = 1 + s_x, b = 1 + s_y, c = cos φ, s = sin φ. Returns λ, its
    gradient (6,) and its second derivative (6, 6) by the strain vector (6,).
    """
    a, shear, b = 1 + strain[0], strain[1], 1 + strain[2]
    c, s = math.cos(angle), math.sin(angle)
    square = (a * c) ** 2 + 2 * shear * a * b * c * s + (b * s) ** 2
    stretch = math.sqrt(square)
    slope = np.array([a * c * c + shear * b * c * s, a * b * c * s, b * s * s + shear * a * c * s, 0.0, 0.0, 0.0])
    bend = np.zeros((6, 6))
    bend[:3, :3] = [
        [c * c, b * c * s, shear * c * s],
        [b * c * s, 0.0, a * c * s],
        [shear * c * s, a * c * s, s * s],
    ]
    return stretch, slope / stretch, bend / stretch - np.outer(slope, slope) / stretch**3
