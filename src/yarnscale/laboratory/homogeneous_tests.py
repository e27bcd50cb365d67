"""Tests of a homogeneous piece of fabric: one macroscopic strain everywhere, found under loads (``homogeneous.loads``).

The same functions serve a periodic cell of yarns (``CellFabric``) and a shell material (``MaterialFabric``). Stretches
and curvatures count from the reference state of the pattern; loads are per metre of rest width.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.homogeneous.fabrics import HomogeneousFabric
from yarnscale.homogeneous.loads import FLAT, LoadedState, Loads, Prescribed, equilibrium_under, path_under
from yarnscale.kinematics import GRAM_FORCE, line_stretch
from yarnscale.numerics.newton import Status

LOADS = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 35.0, 50.0)
"""Default loads of the tension test [N/m]."""
DIRECTIONS = (0.0, 45.0, 90.0)
"""Default directions of pull from the course [degrees]: course, bias, wale (weft, bias, warp of a woven)."""
BENDING_DIRECTIONS = (0.0, 45.0, 90.0, 135.0)
SHEAR_ANGLES = (0.5, 1.0, 2.5, 5.0, 8.0)
"""Trellis angles [degrees]; KES measures between 0.5° and 5°."""
SHEAR_TENSION = 1000 * GRAM_FORCE
"""Tension of the sheared piece along course and wale in KES: 10 gf/cm [N/m]."""
KES_CURVATURES = (50.0, 150.0)
"""Between which KES takes the bending rigidity [1/m]."""
NO_LOADS = Loads()
RATIOS = ((1.0, 1.0), (1.0, 0.5), (0.5, 1.0))
"""Loads along course and wale of the biaxial test, relative to each other."""


@dataclass(frozen=True)
class TensionPoint:
    """A strip under a load, free across: ``stretch`` along and ``contraction`` across, both [-].

    load: [N/m]. energy: stored per rest area [J/m²]. Numbers are NaN where the fabric found no equilibrium.
    """

    direction: float
    load: float
    stretch: float
    contraction: float
    energy: float
    status: str


@dataclass(frozen=True)
class BiaxialPoint:
    """A sheet under tension along course and wale [N/m]: stretch along both [-]."""

    load_course: float
    load_wale: float
    stretch_course: float
    stretch_wale: float
    status: str


@dataclass(frozen=True)
class ShearPoint:
    """A sheet whose courses and wales left the right angle by ``angle`` [degrees] under ``tension`` [N/m] along both.

    force: shear force per width at rest, dΨ/dγ [N/m]. stretch_course, stretch_wale: along both [-].
    """

    angle: float
    tension: float
    force: float
    stretch_course: float
    stretch_wale: float
    status: str


@dataclass(frozen=True)
class BendingPoint:
    """A sheet bent to a cylinder of ``curvature`` [1/m] along a direction, free in its plane: ``moment`` [N]."""

    direction: float
    curvature: float
    moment: float
    status: str


@dataclass(frozen=True)
class TwistPoint:
    """A sheet twisted by II12 = ``twist`` [1/m] with no other curvature, free in its plane: ``moment`` dΨ/dII12 [N]."""

    twist: float
    moment: float
    status: str


@dataclass(frozen=True)
class NaturalCurvature:
    """The curvature [1/m] to which a free piece rolls along a direction, as a cylinder; positive: hollow on the face.

    saved: energy that rolling releases [J/m²].
    """

    direction: float
    curvature: float
    saved: float
    status: str

    @property
    def side(self) -> str:
        """The side inside the roll: "face", "back", "none" (a radius beyond a metre), "unknown" without equilibrium."""
        if math.isnan(self.curvature):
            return "unknown"
        return "none" if abs(self.curvature) < 1.0 else "face" if self.curvature > 0 else "back"


def tension(
    fabric: HomogeneousFabric, direction: float, loads: Sequence[float] = LOADS, *, curvature: str = "flat"
) -> list[TensionPoint]:
    """Pull a strip cut along ``direction`` [degrees from the course] by rising ``loads`` [N/m], free across.

    curvature: "flat", as between the clamps of a wide swatch, or "free", where a strip may curl.
    The strip is free to shear too. Raises InputError.
    """
    angle = math.radians(_finite("direction", direction))
    if curvature not in ("flat", "free"):
        raise InputError("curvature", expected="flat or free", found=curvature)
    states = path_under(
        fabric,
        [Loads.tension(angle, load) for load in checked_loads(loads)],
        prescribed=FLAT if curvature == "flat" else None,
    )
    return [tension_point(direction, load, state) for load, state in zip(loads, states, strict=True)]


def biaxial(
    fabric: HomogeneousFabric, ratio: tuple[float, float], loads: Sequence[float] = LOADS
) -> list[BiaxialPoint]:
    """Pull a flat sheet along course and wale at once; the larger load runs through ``loads`` [N/m]."""
    if len(ratio) != 2 or not all(math.isfinite(r) and r >= 0 for r in ratio) or max(ratio) == 0:
        raise InputError("ratio of loads", expected="two numbers from 0, not both 0", found=ratio)
    course, wale = (r / max(ratio) for r in ratio)
    pulls = [(course * load, wale * load) for load in checked_loads(loads)]
    states = path_under(fabric, [both_ways(*pull) for pull in pulls], prescribed=FLAT)
    return [BiaxialPoint(*pull, *_stretches(state), _status(state)) for pull, state in zip(pulls, states, strict=True)]


def shear(fabric: HomogeneousFabric, angles: Sequence[float] = SHEAR_ANGLES, *, load: float = 0.0) -> list[ShearPoint]:
    """Shear a flat sheet by trellis ``angles`` γ [degrees] under dead loads [N/m] along course and wale.

    s_a = sin γ, so the shear force per width is dΨ/dγ = dΨ/ds_a cos γ.
    """
    steps = _steps(fabric, angles, both_ways(load, load), sheared)
    return [shear_point(angle, load, state) for angle, state in steps]


def bending(
    fabric: HomogeneousFabric, direction: float, curvatures: Sequence[float] | None = None
) -> list[BendingPoint]:
    """Bend a sheet to cylinders whose curvature lies along ``direction`` [degrees from the course].

    curvatures: [1/m], both signs; default ``default_curvatures``. In its plane the sheet is free. The
    moment per width is dΨ/dκ = M11 c² + M12 c s + M22 s², with c, s of the direction and M = dΨ/dII.
    """
    angle = math.radians(_finite("direction", direction))
    if curvatures is None:
        curvatures = default_curvatures(fabric)
    steps = _steps(fabric, curvatures, Loads(), lambda value: Prescribed.bent(angle, value))
    return [bending_point(direction, curvature, state) for curvature, state in steps]


def twist(fabric: HomogeneousFabric, twists: Sequence[float] | None = None) -> list[TwistPoint]:
    """Twist a sheet, free in its plane. twists: II12 [1/m], default as the curvatures of ``bending``."""
    if twists is None:
        twists = default_curvatures(fabric)
    steps = _steps(fabric, twists, Loads(), lambda value: Prescribed.components(II11=0.0, II12=value, II22=0.0))
    return [TwistPoint(value, _number(state, state.stress[4]), _status(state)) for value, state in steps]


def natural_curvature(fabric: HomogeneousFabric, direction: float, loads: Loads = NO_LOADS) -> NaturalCurvature:
    """The cylinder along ``direction`` [0 or 90 degrees] to which a piece rolls by itself, without any load by default.

    A sheet cannot roll along course and wale at once without stretching (its Gaussian curvature would change), so each
    is found with the other at zero.
    """
    if direction not in (0.0, 90.0):
        raise InputError("direction of a roll", expected="0 or 90 degrees", found=direction)
    straight = {"II12": 0.0, "II22" if direction == 0.0 else "II11": 0.0}
    flat = equilibrium_under(fabric, loads, prescribed=FLAT)
    state = equilibrium_under(fabric, loads, prescribed=Prescribed.components(**straight), start=flat)
    value = float(state.strain[3 if direction == 0.0 else 5])
    saved = _number(state, flat.energy - state.energy)
    return NaturalCurvature(direction, _number(state, value), saved, _status(state))


def default_curvatures(fabric: HomogeneousFabric) -> tuple[float, ...]:
    """Curvatures [1/m] from −0.1/r to 0.1/r, r the radius of the yarn, with those of KES (50 and 150 /m) within."""
    largest = float(fabric.strain_scale[3])
    own = set((np.linspace(-1.0, 1.0, 9) * largest).tolist())
    return tuple(sorted(own | {side * kes for side in (-1, 1) for kes in KES_CURVATURES if kes < largest}))


def checked_loads(loads: Sequence[float]) -> tuple[float, ...]:
    """Rising positive loads [N/m]; InputError where they are not."""
    values = tuple(float(load) for load in loads)
    if not values or not all(math.isfinite(v) and v > 0 for v in values):
        raise InputError("loads", expected="positive numbers [N/m]", found=values)
    if any(b <= a for a, b in pairwise(values)):
        raise InputError("loads", expected="rising numbers", found=values)
    return values


def both_ways(course: float, wale: float) -> Loads:
    """Loads [N/m] along course and wale."""
    return Loads.tension(0.0, course) + Loads.tension(0.5 * math.pi, wale)


def sheared(angle: float) -> Prescribed:
    """A flat sheet sheared by a trellis angle [degrees]."""
    return Prescribed.components(s_a=math.sin(math.radians(angle))) + FLAT


def _steps(
    fabric: HomogeneousFabric, values: Sequence[float] | Array, loads: Loads, prescribed: Callable[[float], Prescribed]
) -> Iterator[tuple[float, LoadedState]]:
    """Equilibria with a strain at each of some values, in their order; each from its neighbour towards zero."""
    values = [_finite("value", float(v)) for v in values]
    rest = equilibrium_under(fabric, loads, prescribed=prescribed(0.0))
    found: dict[float, LoadedState] = {}
    for side in (1.0, -1.0):
        start = rest
        for value in sorted((v for v in values if v * side >= 0 and v not in found), key=abs):
            state = rest if value == 0 else equilibrium_under(fabric, loads, prescribed=prescribed(value), start=start)
            found[value] = state
            start = state if state.converged else start
    yield from ((value, found[value]) for value in values)


def tension_point(direction: float, load: float, state: LoadedState) -> TensionPoint:
    """Stretch λ − 1 along the direction and contraction 1 − J/λ of the strip's width, J the change of area."""
    s_x, s_a, s_y = state.strain[:3]
    along = line_stretch(state.strain, math.radians(direction))[0]
    area = (1 + s_x) * (1 + s_y) * math.sqrt(1 - s_a**2)
    stretch, contraction, energy = (_number(state, v) for v in (along - 1, 1 - area / along, state.energy))
    return TensionPoint(direction, load, stretch, contraction, energy, _status(state))


def shear_point(angle: float, load: float, state: LoadedState) -> ShearPoint:
    """A sheet sheared by an angle [degrees] under loads [N/m] along course and wale."""
    force = _number(state, state.stress[1] * math.cos(math.radians(angle)))
    return ShearPoint(angle, load, force, *_stretches(state), _status(state))


def bending_point(direction: float, curvature: float, state: LoadedState) -> BendingPoint:
    """A sheet bent by a curvature [1/m] along a direction [degrees]."""
    c, s = math.cos(math.radians(direction)), math.sin(math.radians(direction))
    moment = _number(state, float(state.stress[3:] @ [c * c, c * s, s * s]))
    return BendingPoint(direction, curvature, moment, _status(state))


def _stretches(state: LoadedState) -> tuple[float, float]:
    return _number(state, state.strain[0]), _number(state, state.strain[2])


def _number(state: LoadedState, value: float) -> float:
    """NaN where the loads are not met: such a number belongs to another load."""
    return float(value) if state.converged else math.nan


def _status(state: LoadedState) -> str:
    return (state.status if state.response.usable else Status.INVALID).name.lower()


def _finite(name: str, value: float) -> float:
    if not math.isfinite(value):
        raise InputError(name, expected="a finite number", found=value)
    return value
