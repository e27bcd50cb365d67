"""Numbers by which textile engineers compare fabrics: KES-F (Kawabata), FAST (CSIRO) and ASTM D1388.

All from the curves of ``homogeneous_tests`` and, where yarns have friction, from the first of their ``cycles``. Without
friction yarns return all work: hysteresis (2HG, 2HG5, 2HB) and resilience RT are None.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from yarnscale.arrays import Array
from yarnscale.kinematics import GRAM_FORCE
from yarnscale.laboratory.cantilever import bending_length
from yarnscale.laboratory.cycles import Cycle
from yarnscale.laboratory.homogeneous_tests import KES_CURVATURES, BendingPoint, ShearPoint, TensionPoint

CENTIMETRE_FORCE = 100 * GRAM_FORCE
"""1 gf/cm [N/m]."""
FAST_LOADS = tuple(grams * CENTIMETRE_FORCE for grams in (5, 20, 100))
"""Loads of FAST-3 [N/m]: of E5, E20, E100."""
FAST_SHEAR = 123.0
"""FAST shear rigidity [N/m] times the bias extension at 5 gf/cm [%]."""
KES_ANGLES = (0.5, 2.5)
"""Between which KES takes the shear stiffness [degrees]."""
KES_LOOPS = (0.5, 5.0)
"""Where KES takes 2HG and 2HG5 [degrees]."""
KES_BENT = 100.0
"""Where KES takes 2HB [1/m]."""


@dataclass(frozen=True)
class TensileSummary:
    """Of one direction, up to the largest load that was reached.

    LT: linearity [-]. WT: work [J/m²] (1 gf·cm/cm² = 0.981 J/m²). EMT: stretch there [-]. RT: resilience [%].
    E5, E20, E100: FAST extensions at 5, 20, 100 gf/cm [%]; None beyond the loads.
    """

    direction: float
    largest_load: float | None
    LT: float | None
    WT: float | None
    EMT: float | None
    RT: float | None
    E5: float | None
    E20: float | None
    E100: float | None


@dataclass(frozen=True)
class BendingSummary:
    """Of one direction. B: rigidity [N·m], mean of both sides between 50 and 150/m (KES), or as far as curvatures go.

    bending_length: ASTM D1388 and FAST C [m], mean of face up and face down; None where the fabric rolls up by itself.
    hysteresis: 2HB [N], width of the loop at 100 /m, or at half of a smaller largest curvature.
    """

    direction: float
    B: float | None
    bending_length: float | None
    hysteresis: float | None = None


@dataclass(frozen=True)
class ShearSummary:
    """G: KES shear stiffness [N/m per degree], mean slope between 0.5° and 2.5° under tension. hysteresis: 2HG and
    2HG5 [N/m], width of the loop at 0.5° and 5°.

    fast_G: FAST shear rigidity [N/m], 123 over the bias extension at 5 gf/cm in per cent.
    """

    G: float | None
    hysteresis: float | None
    hysteresis_5: float | None
    fast_G: float | None


def tensile_summary(points: Sequence[TensionPoint], cycle: Cycle | None = None) -> TensileSummary:
    """Tensile numbers of one direction; cycle: the first, where yarns have friction."""
    good = [p for p in points if p.status == "converged"]
    loads, stretches = [0.0, *(p.load for p in good)], [0.0, *(p.stretch for p in good)]
    e5, e20, e100 = (_interpolated(load, loads, [100 * s for s in stretches]) for load in FAST_LOADS)
    if not good:
        return TensileSummary(points[0].direction, None, None, None, None, None, e5, e20, e100)
    load, stretch = loads[-1], stretches[-1]
    work, returned = float(np.trapezoid(loads, stretches)), None
    if cycle is not None and cycle.status == "converged":
        work, returned = cycle.work, 100.0 * cycle.returned
    linearity = work / (0.5 * load * stretch) if stretch > 0 else None
    return TensileSummary(good[0].direction, load, linearity, work, stretch, returned, e5, e20, e100)


def bending_summary(points: Sequence[BendingPoint], density: float, cycle: Cycle | None = None) -> BendingSummary:
    """Bending numbers of one direction; density: [kg/m²]; cycle: the first, where yarns have friction."""
    good = sorted((p.curvature, p.moment) for p in points if p.status == "converged")
    direction, half = points[0].direction, 0.5 * max(abs(p.curvature) for p in points)
    loop = None if cycle is None else cycle.hysteresis(min(KES_BENT, half))
    if len(good) < 3 or not good[0][0] < 0 < good[-1][0]:
        return BendingSummary(direction, None, None, loop)
    kappa, moment = np.array(good).T
    sides = ((kappa, moment), (-kappa[::-1], -moment[::-1]))
    rigidity = float(np.mean([_rigidity(*side) for side in sides]))
    lengths = [bending_length(*side, density) for side in sides]
    known = [length for length in lengths if length is not None]
    return BendingSummary(direction, rigidity, float(np.mean(known)) if len(known) == 2 else None, loop)


def shear_summary(
    points: Sequence[ShearPoint], bias: Sequence[TensionPoint], cycle: Cycle | None = None
) -> ShearSummary:
    """Shear numbers; points, cycle: under the tension of KES. bias: tension along 45°, for the rigidity of FAST."""
    good = sorted((p for p in points if p.status == "converged"), key=lambda p: p.angle)
    low, high = KES_ANGLES
    first, second = (_interpolated(a, [p.angle for p in good], [p.force for p in good]) for a in (low, high))
    stiffness = None if first is None or second is None else (second - first) / (high - low)
    extension = tensile_summary(bias).E5 if bias else None
    loops = [None if cycle is None else cycle.hysteresis(angle) for angle in KES_LOOPS]
    return ShearSummary(stiffness, loops[0], loops[1], FAST_SHEAR / extension if extension else None)


def _rigidity(kappa: Array, moment: Array) -> float:
    """Slope of M(κ) between the curvatures of KES, or over the last two thirds where the curve ends before."""
    high = min(KES_CURVATURES[1], float(kappa[-1]))
    low = min(KES_CURVATURES[0], high / 3)
    first, second = np.interp([low, high], kappa, moment)
    return float((second - first) / (high - low))


def _interpolated(at: float, x: Sequence[float], y: Sequence[float]) -> float | None:
    """y at a place, linearly between points; None outside them."""
    if not x or not min(x) * (1 - 1e-9) <= at <= max(x) * (1 + 1e-9):
        return None
    return float(np.interp(at, x, y))
