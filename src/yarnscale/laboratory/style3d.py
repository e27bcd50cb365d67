"""The cloth of the solver Style3D in the engine Newton, fitted to the virtual tests of a shell material.

Per triangle, with F = [F_u F_v], a = |F_u|, b = |F_v| and c the cosine of their angle, Newton 1.8 exerts

    P = [k_u (a − 1) û + k_s c v̂,  k_v (b − 1) v̂ + k_s c û],   û = F_u/a, v̂ = F_v/b,

which is no gradient of an energy where a and b differ. Its power by the strains (s_x, s_a, s_y), half the shear turning
each axis, is (k_u (a − 1) + k_s c², k_s c (a + b)/2, k_v (b − 1) + k_s c²). Each inner edge bends with the energy
½ k_e 3/(A_0 + A_1) |Σ w_i x_i|² of Bergou et al. 2006 and k_e = k_0 sin¹²φ + k_1 cos¹²φ + 4 k_2 sin²φ cos²φ, φ its
angle from the u axis. On a grid of squares that are cut from (1, 0) to (0, 1), as ``add_cloth_grid`` makes them,

    ψ = 3/2 k_v̄ (II11 − II12)² + 3/2 k_ū (II22 − II12)² + 6 k_d II12²

with the k_e of its upright, level and slanting edges, k_0, k_1 and (k_0 + k_1)/64 + k_2. Such a grid has a hand: bent
strips twist where the slanting edges are soft, and one diagonal bends more easily than the other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares, minimize_scalar

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.homogeneous.fabrics import Response
from yarnscale.laboratory.homogeneous_tests import TensionPoint, tension
from yarnscale.laboratory.programme import FabricTests, Programme, run_tests
from yarnscale.laboratory.table import Deviation, deviations, measured
from yarnscale.shell.materials.material import ShellMaterial

RANGE = (0.05, 5.0)
"""Default range of loads that the fit serves [N/m]: from the weight of some centimetres to light wear."""
_LOADS = 8
_WEIGHTS = (1.0, 1.0, 1.0, 1.0, 0.1, 0.1)
"""Of bending: cylinders and strips along weft and warp, both diagonals. Grids cannot bend as fabric along all."""
_LEAST_BEND = 1e-9
"""Least rigidity of bending [J]: below it cloth has none."""
_SHEARS = (1e-4, 1e4)
"""Bounds of the shear stiffness over the larger stretch stiffness."""

MISSING = (
    "stiffening: each direction has one stiffness, so stretch grows in proportion to the load",
    "contraction across the pull: the two directions are not coupled",
    "curl: a free piece stays flat, and both sides bend alike",
    "coupling of bending with stretch, and of the two curvatures",
    "bending that is the same on every mesh: the values are those of a grid that add_cloth_grid makes",
)
"""What that model cannot represent."""


@dataclass(frozen=True)
class Style3DCloth:
    """Parameters of Newton's cloth, a homogeneous fabric of its own.

    density: [kg/m²]. stretch: ``tri_aniso_ke``, along weft and warp and in shear [N/m]. bend: ``edge_aniso_ke`` [J].
    strain_scale: (6,), of the material that it stands for.
    """

    density: float
    stretch: tuple[float, float, float]
    bend: tuple[float, float, float]
    strain_scale: Array

    def response(self, strain: Array, start: Response | None = None) -> Response:
        """Energy, to second order in shear, and stress at a strain (6,)."""
        a, c, b = 1 + strain[0], strain[1], 1 + strain[2]
        along, across, shear = self.stretch
        bend = self._bending()
        stress = np.zeros(6)
        stress[:3] = (
            along * (a - 1) + shear * c * c, 0.5 * shear * c * (a + b), across * (b - 1) + shear * c * c,
        )  # fmt: skip
        stress[3:] = bend @ strain[3:]
        energy = 0.5 * (along * (a - 1) ** 2 + across * (b - 1) ** 2 + 0.5 * shear * (a + b) * c * c)
        energy += 0.5 * strain[3:] @ bend @ strain[3:]
        return Response(np.array(strain, np.float64), float(energy), stress)

    def moduli(self, response: Response) -> Array:
        """Symmetric part of the derivative of the stress (6, 6)."""
        a, c, b = 1 + response.strain[0], response.strain[1], 1 + response.strain[2]
        along, across, shear = self.stretch
        found = np.zeros((6, 6))
        found[0, 0], found[1, 1], found[2, 2] = along, 0.5 * shear * (a + b), across
        found[0, 1] = found[1, 0] = found[1, 2] = found[2, 1] = 1.25 * shear * c
        found[3:, 3:] = self._bending()
        return found

    def _bending(self) -> Array:
        return bending_on_grid(np.array(self.bend))


def bending_on_grid(bend: Array) -> Array:
    """Second derivative of ψ by (II11, II12, II22) [J], (3, 3), of ``edge_aniso_ke`` (3,), on the module's grid."""
    upright, level, extra = bend
    ridges = np.array([[1.0, -1.0, 0.0], [0.0, -1.0, 1.0], [0.0, 1.0, 0.0]])
    return ridges.T @ np.diag([3 * upright, 3 * level, 12 * ((upright + level) / 64 + extra)]) @ ridges


@dataclass(frozen=True, eq=False)
class Style3DFit:
    """Newton's cloth for a material and what it loses.

    loads: range of the fit [N/m]. tests: of the material. deviations: all tests within the range. lost: what the cloth
    cannot represent, ``MISSING`` and what else this material has.
    """

    cloth: Style3DCloth
    loads: tuple[float, float]
    tests: FabricTests
    deviations: list[Deviation]
    lost: tuple[str, ...] = MISSING


def fit_style3d(material: ShellMaterial, loads: tuple[float, float] = RANGE) -> Style3DFit:
    """Fit the stretch along weft, warp and bias over a range of loads [N/m] and the rigidities of bending.

    Stretch stiffnesses minimise the squared differences of stretch at loads spread evenly over the decades. Bending
    rigidities are those of KES, mean of both sides: of cylinders and of strips that may twist along weft and warp, and,
    with a tenth of the weight, of cylinders along both diagonals; negative ones become the least that cloth can have.
    Raises InputError for a bad range and for a material that finds no equilibrium there or whose rigidity is not known.
    """
    low, high = loads
    if not 0 < low < high < np.inf:
        raise InputError("range of loads", expected="two rising positive numbers [N/m]", found=loads)
    steps = tuple(float(v) for v in np.geomspace(low, high, _LOADS))
    tests = run_tests(material, programme=Programme(loads=steps))
    along, bias, across = (_good(tests.pulled(direction)) for direction in (0.0, 45.0, 90.0))
    stiff = [_stiffness(points) for points in (along, across)]
    rigidity = _rigidity(tests)
    bend = _edges(*(max(rigidity[direction], _LEAST_BEND) for direction in (0.0, 90.0, 45.0)))
    start = Style3DCloth(material.density, (stiff[0], stiff[1], 0.0), bend, material.strain_scale)

    def sheared(logarithm: float) -> Style3DCloth:
        return replace(start, stretch=(stiff[0], stiff[1], max(stiff) * 10**logarithm))

    def miss(logarithm: float) -> float:
        found = tension(sheared(logarithm), 45.0, [p.load for p in bias])
        differences = np.array([a.stretch - b.stretch for a, b in zip(found, bias, strict=True)])
        return float((np.nan_to_num(differences, nan=1.0) ** 2).sum())

    best: Any = minimize_scalar(miss, bounds=np.log10(_SHEARS).tolist(), method="bounded", options={"xatol": 1e-3})
    cloth = sheared(float(best.x))
    curvatures = tuple(sorted({p.curvature for p in tests.bending}))
    own = run_tests(cloth, name="Newton", programme=Programme(loads=steps, curvatures=curvatures))
    lost = tuple(
        f"negative rigidity of bending along {direction:g}° ({B:.3g} N·m), of fabric that folds by itself"
        for direction, B in rigidity.items() if B < 0
    )  # fmt: skip
    return Style3DFit(cloth, loads, tests, deviations(list(measured(tests)), list(measured(own))), MISSING + lost)


def _edges(weft: float, warp: float, bias: float) -> tuple[float, float, float]:
    """``edge_aniso_ke`` [J] nearest to rigidities of bending [J] along weft, warp and bias, by their logarithms."""
    diagonals = np.array([[0.5, 0.5, 0.5], [0.5, -0.5, 0.5]])
    wanted = np.log([weft, warp, weft, warp, bias, bias])

    def miss(logarithms: Array) -> Array:
        grid = bending_on_grid(np.exp(logarithms))
        strips = 1.0 / np.diag(np.linalg.inv(grid))[[0, 2]]
        slanting = np.einsum("ki,ij,kj->k", diagonals, grid, diagonals)
        found = np.log(np.concatenate([np.diag(grid)[[0, 2]], strips, slanting]))
        return (found - wanted) * _WEIGHTS

    start = np.log([weft / 3, warp / 3, bias / 3])
    first, second, third = np.exp(least_squares(miss, start).x)
    return float(first), float(second), float(third)


def _rigidity(tests: FabricTests) -> dict[float, float]:
    """The rigidities of bending [N·m] that the fit needs, by direction."""
    known = {bent.direction: bent.B for bent in tests.bend}
    found: dict[float, float] = {}
    for direction in (0.0, 45.0, 90.0):
        if (B := known.get(direction)) is None:
            expected = f"an equilibrium bent along {direction:g}°"
            raise InputError("material", expected=expected, found="too few to tell its rigidity")
        found[direction] = B
    return found


def _good(points: list[TensionPoint]) -> list[TensionPoint]:
    found = [p for p in points if p.status == "converged"]
    if not found:
        raise InputError("material", expected="an equilibrium under tension", found="none in the range of loads")
    return found


def _stiffness(points: list[TensionPoint]) -> float:
    """The k [N/m] at which load/k is nearest to the stretch."""
    load, stretch = np.array([(p.load, p.stretch) for p in points]).T
    work = float(load @ stretch)
    if work <= 0:
        raise InputError("material", expected="a material that stretches under load", found=stretch.tolist())
    return float(load @ load) / work
