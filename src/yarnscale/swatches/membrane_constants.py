"""The membrane constants of a shell as bounded unknowns of a fit.

Both kinds of shell have the same form: unknowns are logarithms of what is positive and spans decades, and plain numbers
of the rest. Of EST22's shell, k_xy is sought by its ratio to √(k_xx k_yy), whose magnitude stays below one so that the
energy is bounded below, and the area terms, which may vanish, as multiples of a reference stiffness.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from scipy.optimize import nnls

from yarnscale.arrays import Array
from yarnscale.shell.materials.orthotropic import DirectionalMaterial, OrthotropicMaterial
from yarnscale.shell.materials.stiffening import StiffeningMaterial

ShellModel = Literal["stiffening", "stvk"]

_RATES, _SATURATIONS = np.linspace(0.5, 12.0, 24), np.geomspace(0.05, 8.0, 12)
"""Rates over the largest stretch, and saturations, that are tried."""
_USUAL_CONTRACTION = 0.45
_COMPRESSION, _COUPLING = slice(8, 10), 10
_PLAIN = np.isin(np.arange(13), (6, 7))
"""Unknowns of the stiffening shell that are no logarithms: the saturations."""
_DECADES = 4.0
_TIGHTEST = 0.995
_LARGEST_AREA = 30.0
_LEAST_LOG_AREA = 1e-3
"""The log term of the area alone keeps cloth from shrinking to nothing across (EST22 Fig. 5)."""


@dataclass(frozen=True)
class AlongCurve:
    """One direction's curve in numbers of ``StiffeningMaterial``, without the effect of clamps; secant: [N/m]."""

    secant: float
    stretch: float
    stiffening: float
    rate: float
    contraction: float
    saturation: float

    @classmethod
    def of(cls, stretch: Array, load: Array, contraction: Array | None) -> AlongCurve:
        """The nearest to a load [N/m] and a contraction, None for the usual one, (n,) each."""
        far, secant = float(stretch[-1]), float(load[-1] / stretch[-1])
        fits = []
        for rate in _RATES / far:
            basis = np.column_stack([stretch, np.expm1(rate * stretch) / rate])
            (linear, grown), left = nnls(basis / (1.0 + stretch)[:, None], load / (1.0 + stretch))
            fits.append((left, linear, grown, rate))
        _, linear, grown, rate = min(fits)
        widths = []
        for saturation in _SATURATIONS if contraction is not None else ():
            shape = -np.expm1(-saturation * stretch) / saturation
            slope = float(shape @ contraction / (shape @ shape))
            widths.append((float(np.abs(slope * shape - contraction).sum()), slope, saturation))
        _, slope, saturation = min(widths, default=(0.0, _USUAL_CONTRACTION, 1.0))
        least = 0.01 * secant
        return cls(
            secant, max(linear, least), max(grown, 0.1 * least), float(rate), max(slope, 0.02), float(saturation)
        )


@dataclass(frozen=True)
class Scales:
    """The curves along weft and warp, from which unknowns are counted."""

    weft: AlongCurve
    warp: AlongCurve

    @property
    def reference(self) -> float:
        """Secant stiffness of the fabric as a whole [N/m]."""
        return math.sqrt(self.weft.secant * self.warp.secant)


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Unknowns of a shell, (n,), as many as its constants.

    names: of the constants. low, high: ends of the unknowns. prior: values of those that the measurements do
    not determine. draws: size of random changes of the start. constants: the constants in SI, and jacobian: their
    derivatives by the unknowns (n, n), at unknowns. make: the material without bending, of its constants.
    """

    names: tuple[str, ...]
    low: Array
    high: Array
    prior: Array
    draws: Array
    constants: Callable[[Array], Array]
    jacobian: Callable[[Array], Array]
    make: Callable[..., DirectionalMaterial]

    def material(self, unknowns: Array, *, density: float = 0.2) -> DirectionalMaterial:
        """The material without bending; density: [kg/m²]."""
        return self.make(*(float(k) for k in self.constants(unknowns)), density=density)


def orthotropic_unknowns(scales: Scales) -> Unknowns:
    """Of EST22's shell; the prior is an isotropic fabric without area terms."""
    reference, wide = scales.reference, _DECADES * math.log(10.0)

    def constants(unknowns: Array) -> Array:
        weft, warp, shear = reference * np.exp(unknowns[[0, 2, 3]])
        area, log_area = reference * np.maximum(unknowns[4:], 0.0)
        return np.array([weft, unknowns[1] * math.sqrt(weft * warp), warp, shear, area, log_area])

    def jacobian(unknowns: Array) -> Array:
        weft, coupling, warp, shear, _, _ = constants(unknowns)
        matrix = np.diag([weft, math.sqrt(weft * warp), warp, shear, reference, reference])
        matrix[1, [0, 2]] = coupling / 2
        return matrix

    return Unknowns(
        OrthotropicMaterial.MEMBRANE,
        low=np.array([-wide, -0.9, -wide, -wide, 0.0, _LEAST_LOG_AREA]),
        high=np.array([wide, _TIGHTEST, wide, wide, _LARGEST_AREA, _LARGEST_AREA]),
        prior=np.array([0.0, 0.3, 0.0, math.log(0.35), 0.0, 0.0]),
        draws=np.array([1.0, 0.3, 1.0, 1.0, 1.0, 1.0]),
        constants=constants, jacobian=jacobian, make=OrthotropicMaterial,
    )  # fmt: skip


def stiffening_unknowns(scales: Scales) -> Unknowns:
    """Of the shell that stiffens; ``log_area`` is not sought.

    Logarithms over the numbers of the curves, which are the prior, but for the saturations. Compression is counted from
    the coupling, with which it sets the contraction.
    """
    along, both = ("stretch", "stiffening", "rate", "saturation"), (scales.weft, scales.warp)
    # The coupling acts on a strip as far as it does not contract: by half of its stiffness at most.
    at_rest = np.array([curve.stretch + curve.stiffening for curve in both])
    left = 1.0 - np.array([curve.contraction for curve in both])
    coupling = 0.5 * float((at_rest / left).min())
    usual = np.array([getattr(curve, name) for name in along for curve in both])
    usual[:2] = np.maximum(usual[:2] - coupling * left, 0.2 * usual[:2])
    compression = (left / (1.0 - left))[::-1]
    usual = np.array([*usual, *compression, coupling, 0.35 * math.sqrt(float(at_rest.prod())), 1.0])

    def constants(unknowns: Array) -> Array:
        found = np.where(_PLAIN, unknowns, usual * np.exp(np.where(_PLAIN, 0.0, unknowns)))
        found[_PLAIN] = np.where(np.abs(found[_PLAIN]) < 1e-3, 1e-3, found[_PLAIN])
        found[_COMPRESSION] *= found[_COUPLING]
        return found

    def jacobian(unknowns: Array) -> Array:
        relative = np.eye(len(usual))
        relative[_COMPRESSION, _COUPLING] = 1.0
        return np.where(_PLAIN, 1.0, constants(unknowns))[:, None] * relative

    low = np.log([1e-2, 1e-2, 1e-1, 1e-1, 0.4, 0.4, 1.0, 1.0, 1e-2, 1e-2, 0.05, 0.03, 0.1])
    high = np.log([10.0, 10.0, 1e3, 1e3, 2.5, 2.5, 1.0, 1.0, 1e2, 1e2, 20.0, 100.0, 8.0])
    return Unknowns(
        StiffeningMaterial.MEMBRANE[:-1],
        low=np.where(_PLAIN, -4.0, low),
        high=np.where(_PLAIN, 12.0, high),
        prior=np.where(_PLAIN, usual, 0.0),
        draws=np.array([*np.full(6, 0.3), 1.0, 1.0, 0.5, 0.5, 0.5, 1.0, 0.5]),
        constants=constants, jacobian=jacobian,
        make=partial(StiffeningMaterial, log_area=_LEAST_LOG_AREA * scales.reference),
    )  # fmt: skip


UNKNOWNS = {"stiffening": stiffening_unknowns, "stvk": orthotropic_unknowns}
