"""All points of a fabric's virtual tests as one table: what is prescribed, what was measured, and their units."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from yarnscale.laboratory.cycles import CYCLED, Cycle
from yarnscale.laboratory.programme import FabricTests


@dataclass(frozen=True)
class Measured:
    """One number of one test.

    direction: from the course [degrees], None where a test has none. given, at, unit: what was prescribed, as "load",
    0.5 and "N/m". quantity, value, value_unit: what was measured; NaN without equilibrium.
    """

    test: str
    direction: float | None
    given: str
    at: float
    unit: str
    quantity: str
    value: float
    value_unit: str
    status: str

    @property
    def kind(self) -> tuple[str, str]:
        """Test and quantity, of all directions."""
        return self.test, self.quantity

    @property
    def key(self) -> tuple[object, ...]:
        """What identifies a number in the tables of all fabrics."""
        return (*self.kind, self.direction, self.at)


def measured(tests: FabricTests) -> Iterator[Measured]:
    """Every number of the tests, curve by curve."""
    for p in tests.tension:
        for quantity, value in (("stretch", p.stretch), ("contraction", p.contraction)):
            yield Measured("tension", p.direction, "load", p.load, "N/m", quantity, value, "-", p.status)
    for p in tests.biaxial:
        larger = max(p.load_course, p.load_wale)
        name = f"biaxial {p.load_course / larger:g}:{p.load_wale / larger:g}"
        for direction, value in ((0.0, p.stretch_course), (90.0, p.stretch_wale)):
            yield Measured(name, direction, "larger load", larger, "N/m", "stretch", value, "-", p.status)
    for p in tests.shear:
        name = f"shear under {p.tension:.3g} N/m"
        yield Measured(name, None, "angle", p.angle, "degrees", "force", p.force, "N/m", p.status)
    for p in tests.bending:
        yield Measured("bending", p.direction, "curvature", p.curvature, "1/m", "moment", p.moment, "N", p.status)
    for p in tests.twist:
        yield Measured("twist", None, "twist", p.twist, "1/m", "moment", p.moment, "N", p.status)
    for p in tests.rolls:
        yield Measured("free piece", p.direction, "load", 0.0, "N/m", "curvature", p.curvature, "1/m", p.status)
    for s in tests.bend:
        length = math.nan if s.bending_length is None else s.bending_length
        status = "none" if s.bending_length is None else "converged"
        yield Measured("cantilever", s.direction, "slope", 41.5, "degrees", "bending length", length, "m", status)
    for c in tests.cycles:
        yield from _cycle(c)


def _cycle(cycle: Cycle) -> Iterator[Measured]:
    """Points of both legs, and the works; loading and unloading are tests of their own."""
    name = f"{cycle.test} cycle {cycle.number}"
    given, unit, quantity, value_unit = CYCLED[cycle.test]
    for leg in ("loading", "unloading"):
        for displacement, force in getattr(cycle, leg):
            at, value = (force, displacement) if cycle.test == "tension" else (displacement, force)
            yield Measured(
                f"{name} {leg}", cycle.direction, given, at, unit, quantity, value, value_unit, "converged"
            )  # fmt: skip
    for quantity in ("work", "work_returned", "dissipated"):
        value = getattr(cycle, quantity)
        yield Measured(name, cycle.direction, "cycle", cycle.number, "-", quantity, value, "J/m²", cycle.status)


@dataclass(frozen=True)
class Deviation:
    """A number of a reference beside that of another fabric.

    error: their difference over the reference's number, or over a twentieth of the largest number of its test, in all
    directions, where that is more [%].
    """

    reference: Measured
    other: float
    error: float


def deviations(reference: Sequence[Measured], other: Sequence[Measured]) -> list[Deviation]:
    """Numbers of both tables at the same places, without those that the reference has not."""
    known = {row.key: row.value for row in other}
    largest: dict[tuple[object, ...], float] = {}
    for row in reference:
        if math.isfinite(row.value):
            largest[row.kind] = max(largest.get(row.kind, 0.0), abs(row.value))
    found = []
    for row in reference:
        if row.key not in known or not math.isfinite(row.value):
            continue
        size = max(abs(row.value), 0.05 * largest[row.kind])
        value = known[row.key]
        found.append(Deviation(row, value, 100 * (value - row.value) / size if size else math.nan))
    return found
