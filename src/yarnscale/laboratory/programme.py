"""All tests of one fabric, and what came out: what the command ``test`` runs."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import cached_property, partial
from itertools import product
from typing import Any, Literal, Protocol

import numpy as np

from yarnscale.arrays import Array
from yarnscale.cell.periodic import PeriodicCell
from yarnscale.errors import InputError
from yarnscale.homogeneous.fabrics import HomogeneousFabric, MaterialFabric, Response, fabric_of
from yarnscale.homogeneous.loads import Loads
from yarnscale.laboratory import homogeneous_tests as tests
from yarnscale.laboratory.cycles import Cycle, cycled_tests
from yarnscale.laboratory.drape import DrapeTest
from yarnscale.laboratory.homogeneous_tests import (
    BendingPoint,
    BiaxialPoint,
    NaturalCurvature,
    ShearPoint,
    TensionPoint,
    TwistPoint,
)
from yarnscale.laboratory.summary import (
    BendingSummary,
    ShearSummary,
    TensileSummary,
    bending_summary,
    shear_summary,
    tensile_summary,
)
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.yarn.friction import YarnFriction

Kind = Literal["cell", "shell"]
ROLLED_UNDER = (0.5, 5.0)
"""Tensions under which a material shows to where it rolls up [N/m]."""
_POINTS: dict[str, Any] = {
    "tension": TensionPoint, "biaxial": BiaxialPoint, "shear": ShearPoint, "bending": BendingPoint, "twist": TwistPoint,
    "rolls": NaturalCurvature,
}  # fmt: skip
"""Lists of `FabricTests` and what they hold."""


@dataclass(frozen=True)
class Programme:
    """Tests to be run; ``directions`` [degrees from the course] and ``loads`` [N/m] are of the tension tests.

    curvature: "flat" or "free" under tension, see ``tension``. curvatures: [1/m] of bending and twist; None:
    ``default_curvatures`` of the fabric. cycles: of tension, shear under tension and bending, instead of all other
    tests; None: no cycles, or one where there is friction. friction: of a cell's yarns; a shell material has its own.
    """

    directions: tuple[float, ...] = tests.DIRECTIONS
    loads: tuple[float, ...] = tests.LOADS
    curvature: str = "flat"
    curvatures: tuple[float, ...] | None = None
    friction: YarnFriction | None = None
    cycles: int | None = None

    def __post_init__(self) -> None:
        tests.checked_loads(self.loads)
        if not self.directions or not np.isfinite(self.directions).all():
            raise InputError("directions", expected="finite angles [degrees]", found=self.directions)
        if self.curvature not in ("flat", "free"):
            raise InputError("curvature", expected="flat or free", found=self.curvature)
        if self.curvatures is not None and not np.isfinite(self.curvatures).all():
            raise InputError("curvatures", expected="finite numbers [1/m]", found=self.curvatures)
        if self.friction is not None and self.cycles is None:
            object.__setattr__(self, "cycles", 1)
        if self.cycles is not None and self.cycles < 1:
            raise InputError("cycles", expected="one or more", found=self.cycles)

    def steps(self) -> Iterator[tuple[str, Callable[[HomogeneousFabric], list[Any]]]]:
        """The tests without friction one by one, each with the list that its points belong to."""
        for direction in self.directions:
            pull = partial(tests.tension, loads=self.loads, curvature=self.curvature)
            yield "tension", partial(pull, direction=direction)
        for ratio in tests.RATIOS:
            yield "biaxial", partial(tests.biaxial, ratio=ratio, loads=self.loads)
        for load in (0.0, tests.SHEAR_TENSION):
            yield "shear", partial(tests.shear, load=load)
        for direction in tests.BENDING_DIRECTIONS:
            yield "bending", partial(tests.bending, direction=direction, curvatures=self.curvatures)
        yield "twist", partial(tests.twist, twists=self.curvatures)
        for direction in (0.0, 90.0):
            yield "rolls", lambda fabric, direction=direction: [tests.natural_curvature(fabric, direction)]


@dataclass(frozen=True, eq=False)
class FabricTests:
    """Results of the tests of one fabric. density: [kg/m²]. drape: of the Cusick test, if there was one; shells only.

    friction: of yarns; cycles: with it.
    """

    subject: str
    kind: Kind
    density: float
    tension: list[TensionPoint]
    biaxial: list[BiaxialPoint]
    shear: list[ShearPoint]
    bending: list[BendingPoint]
    twist: list[TwistPoint]
    rolls: list[NaturalCurvature]
    drape: DrapeTest | None = None
    friction: float | None = None
    cycles: tuple[Cycle, ...] = ()

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> FabricTests:
        """From ``plain`` as JSON keeps it, numbers that are null as NaN; without friction and drape."""
        points: dict[str, Any] = {}
        for name, kind in _POINTS.items():
            known = [{f.name: np.nan if p[f.name] is None else p[f.name] for f in fields(kind)} for p in content[name]]
            points[name] = [kind(**values) for values in known]
        return cls(content["subject"], content["kind"], content["density"], **points)

    @property
    def directions(self) -> list[float]:
        """Directions of the tension tests [degrees]."""
        return list(dict.fromkeys(p.direction for p in self.tension))

    def pulled(self, direction: float) -> list[TensionPoint]:
        """Tension along one direction [degrees]."""
        return [p for p in self.tension if p.direction == direction]

    def bent(self, direction: float) -> list[BendingPoint]:
        """Bending along one direction [degrees]."""
        return [p for p in self.bending if p.direction == direction]

    def first_cycle(self, test: str, direction: float) -> Cycle | None:
        """The first cycle of a test along a direction [degrees], where there is one."""
        return next((c for c in self.cycles if (c.test, c.direction) == (test, direction)), None)

    @property
    def tensile(self) -> list[TensileSummary]:
        """Tensile numbers of every direction."""
        return [tensile_summary(self.pulled(d), self.first_cycle("tension", d)) for d in self.directions]

    @cached_property
    def bend(self) -> list[BendingSummary]:
        """Bending numbers of every direction."""
        directions = dict.fromkeys(p.direction for p in self.bending)
        return [bending_summary(self.bent(d), self.density, self.first_cycle("bending", d)) for d in directions]

    @property
    def sheared(self) -> ShearSummary:
        taut = [p for p in self.shear if p.tension > 0]
        return shear_summary(taut, self.pulled(45.0), self.first_cycle("shear", 0.0))

    @property
    def failed(self) -> int:
        """Points and cycles without equilibrium under the load; a drape that did not end well is one."""
        points = [*self.cycles, *(point for name in _POINTS for point in getattr(self, name))]
        draped = self.drape is None or self.drape.succeeded
        return sum(p.status != "converged" for p in points) + (not draped)

    def plain(self) -> dict[str, object]:
        """Everything as plain values."""
        content: dict[str, object] = {"subject": self.subject, "kind": self.kind, "density": self.density}
        for name in ("tension", "biaxial", "shear", "bending", "twist"):
            content[name] = [asdict(p) for p in getattr(self, name)]
        content["natural_curvature"] = [p.curvature for p in self.rolls]
        content["rolls"] = [asdict(p) | {"side": p.side} for p in self.rolls]
        content["summary"] = {
            "tension": [asdict(s) for s in self.tensile],
            "bending": [_named(asdict(s), hysteresis="2HB") for s in self.bend],
            "shear": _named(asdict(self.sheared), hysteresis="2HG", hysteresis_5="2HG5"),
        }
        if self.friction is not None:
            content["friction"] = self.friction
        if self.cycles:
            content["cycles"] = {
                name: [c.plain() for c in self.cycles if c.test == name] for name in ("tension", "shear", "bending")
            }
        if self.drape is not None:
            good = self.drape.succeeded
            content["drape_coefficient"] = self.drape.coefficient if good else None
            content["folds"] = self.drape.folds if good else None
            content["drape_status"] = self.drape.status
        return content


class TestedCloth(HomogeneousFabric, Protocol):
    """Homogeneous fabric with a mass per area [kg/m²]: the cloth of another engine."""

    @property
    def density(self) -> float: ...


def _named(content: dict[str, Any], **names: str) -> dict[str, Any]:
    """Values under the names that laboratories use."""
    return {names.get(name, name): value for name, value in content.items()}


def run_tests(
    subject: PeriodicCell | ShellMaterial | TestedCloth,
    *,
    name: str | None = None,
    programme: Programme | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> FabricTests:
    """Run a programme on a cell of yarns, on a shell material or on another cloth, by the same tests.

    name: of the subject, for tables; ``progress`` gets the tests done and in all. A point without equilibrium has
    another ``status`` than "converged", and NaN for numbers.
    """
    kind: Kind = "shell"
    if isinstance(subject, PeriodicCell):
        fabric, kind, density, own = fabric_of(subject), "cell", subject.area_density, subject.pattern.name
    else:
        fabric = fabric_of(subject) if isinstance(subject, ShellMaterial) else subject
        density, own = subject.density, type(subject).__name__
    programme, found = programme or Programme(), defaultdict[str, list[Any]](list)
    steps = list(programme.steps()) if programme.cycles is None else list(_cycled_steps(subject, fabric, programme))
    for number, (test_name, test) in enumerate(steps):
        if progress is not None:
            progress(number, len(steps))
        points = test(fabric)
        if programme.cycles is not None:
            points, cycles = points
            found["cycles"] += cycles
        found[test_name] += points
    if progress is not None:
        progress(len(steps), len(steps))
    friction = programme.friction.coefficient if kind == "cell" and programme.friction is not None else None
    return FabricTests(
        name or own, kind, density, found["tension"], found["biaxial"], found["shear"], found["bending"],
        found["twist"], found["rolls"], friction=friction, cycles=tuple(found["cycles"]),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Recorded(MaterialFabric):
    """A piece of shell that keeps the strains it passes."""

    passed: list[Array] = field(default_factory=list)

    def moduli(self, response: Response) -> Array:
        self.passed.append(response.strain)
        return super().moduli(response)


def strains_of_tests(material: ShellMaterial) -> Array:
    """Strains (n, 6) that a material passes in its own tests, and where it rolls up across tension."""
    fabric = _Recorded(material)
    for _, test in Programme().steps():
        test(fabric)
    for across, load in product((0.0, 90.0), ROLLED_UNDER):
        tests.natural_curvature(fabric, across, Loads.tension(np.radians(90.0 - across), load))
    return np.array(fabric.passed)


def _cycled_steps(
    subject: object, fabric: HomogeneousFabric, programme: Programme
) -> Iterator[tuple[str, Callable[[Any], Any]]]:
    """The tests of fabric with friction; each gives its points and its cycles."""
    if isinstance(subject, PeriodicCell):
        if programme.friction is None:
            raise InputError("cycles", expected="friction of the yarns with them", found="none")
    elif not isinstance(subject, ShellMaterial) or not subject.remembers:
        raise InputError("cycles", expected="yarns, or a shell material with friction", found="one without memory")
    options = (programme.directions, programme.loads, programme.curvature, programme.curvatures)
    for test in cycled_tests(fabric, *options):
        yield test.name, lambda _, test=test: test.run(subject, programme.friction, programme.cycles or 1)


@dataclass(frozen=True)
class Difference:
    """How far one fabric is off another in tension. stretch, contraction: largest differences [-]; allowed: share of
    points within 0.01 + 3 % (stretch) and 0.02 + 3 % (contraction) of the reference."""

    points: int
    stretch: float
    contraction: float
    stretch_within: float
    contraction_within: float


def difference(tested: Sequence[TensionPoint], reference: Sequence[TensionPoint]) -> Difference:
    """Compare tension points of the same directions and loads.

    Points without equilibrium in the reference are left out; a point that only the tested fabric cannot reach counts as
    off. Raises InputError where none match.
    """
    known = {(p.direction, p.load): p for p in tested}
    pairs = [
        (known[p.direction, p.load], p) for p in reference if p.status == "converged" and (p.direction, p.load) in known
    ]
    if not pairs:
        raise InputError("fabrics to compare", expected="the same directions and loads", found="none in common")
    numbers = np.array([[a.stretch, b.stretch, a.contraction, b.contraction] for a, b in pairs])
    stretch, contraction = np.abs(numbers[:, 0] - numbers[:, 1]), np.abs(numbers[:, 2] - numbers[:, 3])
    stretch_ok = stretch <= 0.01 + 0.03 * np.abs(numbers[:, 1])
    contraction_ok = contraction <= 0.02 + 0.03 * np.abs(numbers[:, 3])
    return Difference(
        len(pairs), float(np.nanmax(stretch, initial=0.0)), float(np.nanmax(contraction, initial=0.0)),
        float(stretch_ok.mean()), float(contraction_ok.mean()),
    )  # fmt: skip
