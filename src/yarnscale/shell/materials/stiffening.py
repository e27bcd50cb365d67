"""An orthotropic material of fabric that stiffens while it is pulled, with a contraction of its own in each direction.

The polynomial of EST22 eq. 1 cannot be soft at first and stiff in the end, and ties the contraction along the warp to
that along the weft. Here, with the stretches s_x = √I11 − 1, s_y = √I22 − 1 and γ = I12,

    ψ = f_x(s_x) + f_y(s_y) + ½ coupling (p_x(s_x) + p_y(s_y))² + g(γ) + log_area ln²J + bending
    f(s) = ½ stretch s₊² + stiffening/rate² (exp(rate s₊) − rate s₊ − 1) + ½ compression s₋²
    p(s) = (1 − exp(−saturation s₊))/saturation + s₋
    g(γ) = shear/shear_rate² (cosh(shear_rate γ) − 1)

and s = s₊ + s₋ the parts above and below zero, smooth over ``KINK``. A strip pulled along the weft contracts by
c = p_x(s) coupling/(coupling + compression_warp), one pulled along the warp by its own numbers; both ratios are below
one. Bending is that of the orthotropic material.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from yarnscale.errors import InputError
from yarnscale.shell.materials.orthotropic import DirectionalMaterial, area_ratio

KINK = 0.005
"""Stretch over which tension passes to compression."""
_LARGEST_EXPONENT = 100.0
"""Beyond, energies are far above those of any cloth; they stay finite."""


@dataclass(frozen=True)
class StiffeningMaterial(DirectionalMaterial):
    """Cloth that stiffens exponentially along weft, warp and in shear (see the module's text).

    stretch_…, stiffening_…, compression_…, coupling, shear, log_area: [N/m]. rate_…, saturation_…, shear_rate: [-].
    The rest: ``DirectionalMaterial``. Raises InputError for rates and saturations of zero.
    """

    stretch_weft: float
    stretch_warp: float
    stiffening_weft: float
    stiffening_warp: float
    rate_weft: float
    rate_warp: float
    saturation_weft: float
    saturation_warp: float
    compression_weft: float
    compression_warp: float
    coupling: float
    shear: float
    shear_rate: float
    log_area: float = 0.0

    MEMBRANE = (
        "stretch_weft", "stretch_warp", "stiffening_weft", "stiffening_warp", "rate_weft", "rate_warp",
        "saturation_weft", "saturation_warp", "compression_weft", "compression_warp", "coupling", "shear", "shear_rate",
        "log_area",
    )  # fmt: skip
    SIGNED = ("saturation_weft", "saturation_warp")

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("rate_weft", "rate_warp", "shear_rate", *self.SIGNED):
            if not abs(getattr(self, name)) >= 1e-3:
                raise InputError(name, expected="at least 0.001 in size", found=getattr(self, name))

    @staticmethod
    def membrane_energy(forms: ca.SX, constants: ca.SX) -> ca.SX:
        """The module's energy."""
        k_x, k_y, e_x, e_y, b_x, b_y, n_x, n_y, m_x, m_y, coupling, shear, b_s, log_area = ca.vertsplit(constants)
        energy, across = 0, 0
        for form, k, e, b, n, m in ((forms[0], k_x, e_x, b_x, n_x, m_x), (forms[2], k_y, e_y, b_y, n_y, m_y)):
            s = ca.sqrt(ca.fmax(form, 1e-100)) - 1
            pulled = 0.5 * (s + ca.sqrt(s * s + KINK * KINK) - KINK)
            pushed = s - pulled
            grown = _exp(b * pulled) - b * pulled - 1
            energy += 0.5 * k * pulled * pulled + e / (b * b) * grown + 0.5 * m * pushed * pushed
            across += (1 - _exp(-n * pulled)) / n + pushed
        turned = _exp(b_s * forms[1])
        sheared = shear / (b_s * b_s) * (0.5 * (turned + 1 / turned) - 1)
        return energy + 0.5 * coupling * across * across + sheared + log_area * area_ratio(forms)[1] ** 2


def _exp(exponent: ca.SX) -> ca.SX:
    return ca.exp(ca.fmax(ca.fmin(exponent, _LARGEST_EXPONENT), -_LARGEST_EXPONENT))
