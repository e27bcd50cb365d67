"""What is measured on swatches of a fabric: stretch and pear-loop tests, and what the fabric is made of (EST22 §4).

A stretch test holds a swatch between two clamps, pulls, and reads force, distance of the clamps and the width half
way between them. Only loading counts. Strain is relative to the lengths at zero force, which are extrapolated for
every run by itself: fabric is so soft at first that no clamp can be set to zero force by hand. Runs are
averaged at equal force, and the spread over runs is kept.

Forces are compared as line loads, force over the width of the swatch at rest. EST22's ranges, 2 N for comfort
and 5 N for power on swatches of 6 cm, are 33 N/m and 83 N/m.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError, positive
from yarnscale.swatches.construction import KnownConstruction, YarnComposition
from yarnscale.swatches.loading_start import at_zero_force

LENGTH = "a positive length [m]"
"""What errors of lengths expect."""
COMFORT_LOAD = 2.0 / 0.06
"""Line load up to which clothes are worn in comfort [N/m] (EST22 §4.3)."""
POWER_LOAD = 5.0 / 0.06
"""Largest line load of sportswear [N/m] (EST22 §4.3)."""


class Direction(Enum):
    """Direction of the fabric that a swatch is pulled or bent along."""

    WEFT = "weft"
    BIAS = "bias"
    WARP = "warp"

    @property
    def angle(self) -> float:
        """Angle from the course (weft) direction [rad]."""
        return {"weft": 0.0, "bias": math.pi / 4, "warp": math.pi / 2}[self.value]


@dataclass(frozen=True, eq=False)
class Unloading:
    """Unloading of the swatch, which the fit of friction alone uses.

    force [N] and length [m] in the order of time, (n,); lost_work: share of the work of the loading that is not given
    back, None where unloading was not measured to its end.
    """

    force: Array
    length: Array
    lost_work: float | None


@dataclass(frozen=True, eq=False)
class StretchRun:
    """One loading of a swatch.

    force: [N]; length: distance of the clamps [m]; width: at the middle [m], None where it was not measured; all (n,).
    unloading: what followed, None where it was not measured.
    force never falls. Raises InputError for anything that is not such a run.
    """

    name: str
    force: Array
    length: Array
    width: Array | None = None
    unloading: Unloading | None = None

    def __post_init__(self) -> None:
        where = f"run '{self.name}'"
        for name in ("force", "length", "width"):
            values = getattr(self, name)
            if values is None:
                continue
            array = np.array(values, dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
            if array.ndim != 1 or not np.isfinite(array).all():
                raise InputError(f"{name} of {where}", expected="a list of finite numbers", found=values)
            if (array < 0).any() or (name != "force" and (array == 0).any()):
                raise InputError(f"{name} of {where}", expected="positive numbers", found=f"{array.min():g}")
            if len(array) != len(self.force):
                raise InputError(f"{name} of {where}", expected=f"{len(self.force)} readings", found=len(array))
        if len(self.force) < 3:
            raise InputError(f"readings of {where}", expected="3 or more", found=len(self.force))
        falls = np.flatnonzero(np.diff(self.force) < 0)
        if len(falls):
            raise InputError(
                f"force of {where} at reading {falls[0] + 2}", expected="loading only: force that does not fall",
                found=f"{self.force[falls[0] + 1]:g} N after {self.force[falls[0]]:g} N",
            )  # fmt: skip
        if not self.force[-1] > self.force[0]:
            raise InputError(f"force of {where}", expected="force that grows", found=f"{self.force[0]:g} N throughout")

    @cached_property
    def rest_length(self) -> float:
        """Distance of the clamps at zero force [m]."""
        return at_zero_force(self.force, self.length)

    @cached_property
    def rest_width(self) -> float | None:
        """Width at the middle at zero force [m]."""
        return None if self.width is None else at_zero_force(self.force, self.width)

    @property
    def stretch(self) -> Array:
        """Stretch s of every reading, length over rest length less one, (n,)."""
        return self.length / self.rest_length - 1.0

    @property
    def contraction(self) -> Array | None:
        """Orthogonal compression c, one less width over rest width, (n,)."""
        return None if self.width is None or self.rest_width is None else 1.0 - self.width / self.rest_width


@dataclass(frozen=True, eq=False)
class StretchCurve:
    """Mean of the runs of a stretch test at common line loads, from zero; every array (n,).

    load: force per rest width [N/m]; stretch, contraction: mean over runs, contraction None where not measured.
    stretch_spread, contraction_spread: standard deviation over runs at equal load.
    """

    direction: Direction
    load: Array
    stretch: Array
    stretch_spread: Array
    contraction: Array | None
    contraction_spread: Array | None

    def load_at(self, stretch: Array) -> Array:
        """Line load at stretches inside the curve [N/m], by monotone cubics."""
        return between(stretch, self.stretch, self.load)

    def contraction_at(self, stretch: Array) -> Array | None:
        """Contraction at stretches inside the curve."""
        return None if self.contraction is None else between(stretch, self.stretch, self.contraction)

    def stretch_at(self, load: float) -> float:
        """Stretch at a line load [N/m], the largest measured one where the load is beyond the curve."""
        return float(np.interp(load, self.load, self.stretch))

    def up_to(self, load: float) -> StretchCurve:
        """The curve up to a line load [N/m]."""
        if load >= self.load[-1]:
            return self
        grid = np.append(self.load[self.load < (1.0 - 1e-9) * load], load)

        def cut(values: Array | None) -> Array | None:
            return None if values is None else np.interp(grid, self.load, values)

        stretch, spread = (np.interp(grid, self.load, self.stretch), np.interp(grid, self.load, self.stretch_spread))
        return StretchCurve(self.direction, grid, stretch, spread, cut(self.contraction), cut(self.contraction_spread))


@dataclass(frozen=True, eq=False)
class StretchTest:
    """Runs of swatches of one size along one direction.

    swatch_width: at the clamps [m]. The length of the swatch is the mean length at zero force.
    """

    direction: Direction
    swatch_width: float
    runs: tuple[StretchRun, ...]

    def __post_init__(self) -> None:
        if not self.runs:
            raise InputError(f"stretch test along {self.direction.value}", expected="one or more runs", found="none")
        positive("swatch width", self.swatch_width, LENGTH)

    @property
    def swatch_length(self) -> float:
        """Distance of the clamps at zero force, mean over runs [m]."""
        return float(np.mean([run.rest_length for run in self.runs]))

    @property
    def gauge_width(self) -> float | None:
        """Width at zero force over which contraction was measured, mean over runs [m]; the swatch's at most."""
        widths = [run.rest_width for run in self.runs if run.rest_width is not None]
        return min(float(np.mean(widths)), self.swatch_width) if widths else None

    @property
    def lost_work(self) -> float | None:
        """Share of the work lost in unloading, mean over runs; None where it was not measured."""
        lost = [run.unloading.lost_work for run in self.runs if run.unloading is not None]
        known = [share for share in lost if share is not None]
        return float(np.mean(known)) if known else None

    @cached_property
    def curve(self) -> StretchCurve:
        """Mean curve over the loads that every run reached."""
        top = min(run.force[-1] for run in self.runs)
        grid = np.unique(np.concatenate([[0.0, top], *(run.force for run in self.runs)]))
        grid = grid[grid <= top]
        keep = np.append(True, np.diff(grid) > 1e-6 * top)
        grid = grid[keep]
        stretch = np.array([_over(grid, run.force, run.stretch) for run in self.runs])
        measured = [run.contraction for run in self.runs]
        contraction = None
        if all(c is not None for c in measured):
            pairs = zip(self.runs, measured, strict=True)
            contraction = np.array([_over(grid, run.force, c) for run, c in pairs if c is not None])
        mean = _rising(stretch.mean(axis=0))
        return StretchCurve(
            self.direction, grid / self.swatch_width, mean, _spread(stretch),
            None if contraction is None else contraction.mean(axis=0),
            None if contraction is None else _spread(contraction),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class BendTest:
    """Pear loops of one swatch: the aspect ratio of the loop at distances of the clamps (EST22 §4.3).

    swatch_length: between the clamps, swatch_width: across [m]. distance: of the clamps [m], ratio: height over width
    of the loop, mean over runs, both (n,).
    """

    direction: Direction
    swatch_length: float
    swatch_width: float
    distance: Array
    ratio: Array

    def __post_init__(self) -> None:
        for name in ("swatch_length", "swatch_width"):
            positive(name, getattr(self, name), LENGTH)
        for name in ("distance", "ratio"):
            array = np.array(getattr(self, name), dtype=np.float64)
            object.__setattr__(self, name, array)
            if array.ndim != 1 or not len(array) or len(array) != len(self.distance):
                raise InputError(f"bend test: {name}", expected="as many as distances", found=array.shape)
            if not np.isfinite(array).all() or (array <= 0).any():
                raise InputError(f"bend test: {name}", expected="positive numbers", found=array.min())
        if (self.distance >= 2 * self.swatch_length / math.pi).any():
            raise InputError(
                "bend test: distance of the clamps", found=f"{self.distance.max():g} m",
                expected=f"a loop: less than 2/π of the swatch's length {self.swatch_length:g} m",
            )  # fmt: skip


@dataclass(frozen=True, eq=False)
class BiaxialTest:
    """Fabric pulled along weft and warp at once: stretch and load [N/m] of both, (n, 2) each."""

    stretch: Array
    load: Array

    def __post_init__(self) -> None:
        for name in ("stretch", "load"):
            array = np.array(getattr(self, name), np.float64)
            object.__setattr__(self, name, array)
            if array.ndim != 2 or array.shape != (len(self.load), 2) or not np.isfinite(array).all():
                raise InputError(f"biaxial test: {name}", expected="finite pairs", found=array.shape)
        if not (self.load > 0).any() or (self.stretch <= -0.9).any():
            raise InputError("biaxial test", expected="fabric under tension", found="none")

    def up_to(self, load: float, states: int) -> BiaxialTest:
        """At most so many states, evenly spaced in their order, whose larger load is no larger [N/m]."""
        within = np.flatnonzero((self.load.max(axis=1) <= load) & (self.load.max(axis=1) > 0))
        chosen = np.unique(within[np.linspace(0, len(within) - 1, states).astype(int)]) if len(within) else within
        return BiaxialTest(self.stretch[chosen], self.load[chosen])


@dataclass(frozen=True)
class BendingRigidity:
    """Rigidity B of a cylinder bent along one direction [N m], moment B κ per width; spread: over cycles and sides."""

    direction: Direction
    rigidity: float
    spread: float = 0.0

    def __post_init__(self) -> None:
        positive(f"bending rigidity along {self.direction.value}", self.rigidity, "a positive number [N m]")


@dataclass(frozen=True, eq=False)
class SwatchMeasurements:
    """Everything measured on one fabric, one test per direction at most (EST22 §4.4).

    area_density: mass of the fabric [kg/m²]; pear loops need it. pattern: its pattern, by name or file, for estimates
    that name no other. photographs: names, for the record. notes: sentences on how the numbers were read. known: what
    was counted on the fabric. short: stretch tests of strips shorter than wide, which show how the fabric resists
    contraction. rigidity: of bending, measured by other means than pear loops. biaxial: both directions pulled at once.
    """

    name: str
    stretch: tuple[StretchTest, ...] = ()
    bend: tuple[BendTest, ...] = ()
    yarns: tuple[YarnComposition, ...] = ()
    area_density: float | None = None
    pattern: str | None = None
    photographs: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    known: KnownConstruction = field(default_factory=lambda: KnownConstruction())
    short: tuple[StretchTest, ...] = ()
    rigidity: tuple[BendingRigidity, ...] = ()
    biaxial: BiaxialTest | None = None

    def __post_init__(self) -> None:
        where = f"measurements of '{self.name}'"
        if not self.stretch and not self.bend:
            raise InputError(where, expected="a stretch or bend test", found="none")
        for kind in (self.stretch, self.bend, self.short, self.rigidity):
            directions = [test.direction for test in kind]
            if len(set(directions)) < len(directions):
                raise InputError(where, expected="one test of a kind per direction", found="two")
        if self.area_density is not None:
            positive("area_density", self.area_density, "a positive number [kg/m²]")
        if self.bend and self.area_density is None:
            raise InputError(where, expected="area_density with bend tests: loops hang by their weight", found="none")
        total = sum(yarn.mass_share for yarn in self.yarns)
        if self.yarns and abs(total - 1) > 0.02:
            raise InputError(f"mass_share of the yarns of '{self.name}'", expected="a sum of 1", found=f"{total:g}")

    @property
    def stiffest_yarn(self) -> float | None:
        """Largest stretch stiffness of a yarn [N], EST22's k_s2; None where none is known."""
        return max((yarn.stiffness for yarn in self.yarns if yarn.stiffness is not None), default=None)

    @property
    def yarn_bending(self) -> float | None:
        """Bending stiffness of the only yarn as measured [N m²]; None where it was not, or there are several."""
        return self.yarns[0].bending_stiffness if len(self.yarns) == 1 else None

    @property
    def yarn_count(self) -> float | None:
        """Mass per length of the yarn [kg/m], as known or of the only yarn; None where there are several."""
        of_yarn = self.yarns[0].denier / 9e6 if len(self.yarns) == 1 else None
        return of_yarn if self.known.yarn_count is None else self.known.yarn_count

    def knowing(self, known: KnownConstruction) -> SwatchMeasurements:
        """A copy with more data on the construction; new values replace old ones."""
        said = {name: value for name, value in vars(known).items() if value is not None}
        density = said.get("area_density", self.area_density)
        return replace(self, area_density=density, known=replace(self.known, **said))

    def only(self, *directions: Direction) -> SwatchMeasurements:
        """The same fabric with the tests along these directions alone. Raises InputError where none is left.

        Biaxial tests stay where neither weft nor warp is left out.
        """
        kinds = ("stretch", "bend", "short", "rigidity")
        chosen = {kind: tuple(t for t in getattr(self, kind) if t.direction in directions) for kind in kinds}
        left_out = {test.direction for test in self.stretch} - {*directions, Direction.BIAS}
        return replace(self, **chosen, biaxial=None if left_out else self.biaxial)


def between(points: Array, x: Array, y: Array) -> Array:
    """Monotone cubic interpolation, constant outside."""
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(x, y)(np.clip(points, x[0], x[-1]))


def _over(grid: Array, force: Array, values: Array) -> Array:
    """Values at common forces; before the first reading on the line to zero strain at zero force."""
    if force[0] > 0:
        force, values = np.append(0.0, force), np.append(0.0, values)
    levels, place = np.unique(force, return_inverse=True)
    mean = np.bincount(place, values) / np.bincount(place)
    return np.interp(grid, levels, mean)


def _rising(values: Array) -> Array:
    """The nearest curve that rises everywhere: readings of one length at two forces are set slightly apart."""
    from scipy.optimize import isotonic_regression

    rising = isotonic_regression(values).x
    return rising + 1e-9 * np.arange(len(values))


def _spread(values: Array) -> Array:
    """Standard deviation over runs, zero for one run."""
    return values.std(axis=0, ddof=1) if len(values) > 1 else np.zeros(values.shape[1])
