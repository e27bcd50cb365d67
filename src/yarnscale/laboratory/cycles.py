"""Cycles of tension, shear and bending of fabric with friction: loops, and how much of the work comes back.

A cycle of tension goes from no load through rising loads and back; one of shear or bending to one side and back, then
to the other. Every test begins at rest with slack contacts; cycles follow each other without a pause.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from yarnscale.cell.periodic import PeriodicCell
from yarnscale.homogeneous.fabrics import HomogeneousFabric
from yarnscale.homogeneous.histories import FabricHistory, followed, history_of, loaded_state, under_loads
from yarnscale.homogeneous.loads import FLAT, LoadedState, Loads, Prescribed
from yarnscale.laboratory import homogeneous_tests as tests
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.yarn.friction import YarnFriction

STEPS = 4
"""Steps between the values at which points are measured."""
_PRE_TENSION_STEPS = 4
CYCLED = {
    "tension": ("load", "N/m", "stretch", "-"),
    "shear": ("angle", "degrees", "force", "N/m"),
    "bending": ("curvature", "1/m", "moment", "N"),
}
"""What is prescribed in a cycle and what is measured, with their units."""
_OPTIONS = {"tension": "loads", "bending": "curvatures"}
"""Options of ``test`` with these values."""

Pair = tuple[float, float]


@dataclass(frozen=True)
class Cycle:
    """One cycle of a test ("tension", "shear", "bending") along a direction [degrees]; number: from 1.

    loading, unloading: points (stretch [-], load [N/m]), (trellis angle [degrees], force [N/m]) or (curvature [1/m],
    moment [N]) from zero outwards and back. work, work_returned: on these legs [J/m²]; dissipated: by friction on
    both [J/m²]. NaN in a cycle that was not completed, as ``status`` says; stopped: where that was, and what to do.
    """

    test: str
    direction: float
    number: int
    loading: tuple[Pair, ...]
    unloading: tuple[Pair, ...]
    work: float
    work_returned: float
    dissipated: float
    status: str
    stopped: str = ""

    @property
    def returned(self) -> float:
        """Share of the work that comes back."""
        return self.work_returned / self.work

    def hysteresis(self, place: float) -> float | None:
        """Width of the loop at an angle or curvature: force on loading less that on unloading, mean of both sides."""
        widths = []
        for side, pair in zip((1.0, -1.0), self.sides, strict=True):
            legs = [sorted((side * x, side * y) for x, y in leg) for leg in pair]
            if all(leg and leg[-1][0] >= place * (1 - 1e-9) for leg in legs):
                up, down = (float(np.interp(place, *np.array(leg).T)) for leg in legs)
                widths.append(up - down)
        return float(np.mean(widths)) if widths and self.status == "converged" else None

    @property
    def sides(self) -> list[list[tuple[Pair, ...]]]:
        """Points of loading and unloading on the positive side, and on the other."""
        outwards = sum(x > 0 for x, _ in self.loading)
        split = outwards + 1 if outwards else 0
        return [[leg[part] for leg in (self.loading, self.unloading)] for part in (slice(split), slice(split, None))]

    def plain(self) -> dict[str, Any]:
        """As plain values."""
        given, _, measured, _ = CYCLED[self.test]
        names = (measured, given) if self.test == "tension" else (given, measured)
        content: dict[str, Any] = {"direction": self.direction, "cycle": self.number}
        for leg in ("loading", "unloading"):
            content[leg] = [dict(zip(names, point, strict=True)) for point in getattr(self, leg)]
        numbers = {name: getattr(self, name) for name in ("work", "work_returned", "dissipated", "status", "stopped")}
        return content | numbers


@dataclass(frozen=True)
class CycledTest:
    """A test to be cycled.

    sides: values from zero outwards, load, angle or curvature. point: what is measured at a value. read: of a point,
    its displacement (stretch, angle or curvature) and force. solver: how a value is reached. held: strains prescribed
    before the test begins. pre_tension: loads along course and wale by then [N/m]. unit: of the displacement, so that
    force times displacement times unit is work per area.
    """

    name: str
    direction: float
    sides: tuple[tuple[float, ...], ...]
    solver: Callable[[float], Any]
    point: Callable[[float, LoadedState], Any]
    read: Callable[[Any], Pair]
    held: Prescribed
    pre_tension: float = 0.0
    unit: float = 1.0

    def run(
        self, subject: PeriodicCell | ShellMaterial, friction: YarnFriction | None, cycles: int
    ) -> tuple[list[Any], list[Cycle]]:
        """Points of the first leg from zero, and the cycles; friction: of a cell's yarns."""
        here = history_of(subject, friction, self.held)
        stopped = "" if here is not None else "no equilibrium without load; relax the pattern first (yarnscale pattern)"
        if here is not None and self.pre_tension:
            pulls = np.linspace(0.0, self.pre_tension, _PRE_TENSION_STEPS + 1)[1:].tolist()
            found = list(followed(here, 0.0, pulls, lambda pull: under_loads(tests.both_ways(pull, pull), self.held)))
            here = found[-1] if len(found) == len(pulls) else None
            stopped = "" if here is not None else f"no equilibrium under the tension of {pulls[len(found)]:.4g} N/m"
        first: list[Any] = []
        done: list[Cycle] = []
        for number in range(1, cycles + 1):
            legs: list[list[list[tuple[Pair, float, bool]]]] = [[], []]
            for side in self.sides:
                for leg, values in enumerate(((0.0, *side), (*side[::-1], 0.0))):
                    points, trace, here, lost = self._leg(here, values)
                    stopped = stopped or ("" if lost is None else self._stopped(number, leg, lost))
                    first += points if number == 1 and leg == 0 else []
                    legs[leg].append(trace)
            done.append(self._cycle(number, legs, stopped))
        return first, done

    def _leg(
        self, here: FabricHistory | None, values: Sequence[float]
    ) -> tuple[list[Any], list[Any], FabricHistory | None, float | None]:
        """Points at values after the first; of all steps displacement, force, dissipated, measured; the end; the value
        that was not reached from the one before."""
        points, trace, lost = [], [], None
        if here is not None:
            trace.append((self._read(values[0], here), 0.0, True))
        for first, last in pairwise(values):
            steps = np.linspace(first, last, STEPS + 1)[1:].tolist()
            found = [] if here is None else list(followed(here, first, steps, self.solver))
            trace += [
                (self._read(value, history), history.dissipated, value == last)
                for value, history in zip(steps, found, strict=False)
            ]
            lost = steps[len(found)] if here is not None and len(found) < STEPS else lost
            here = found[-1] if len(found) == STEPS else None
            points.append(self.point(last, loaded_state(here)))
        return points, trace, here, lost

    def _stopped(self, number: int, leg: int, value: float) -> str:
        """What to say of a value that was not reached."""
        option = (
            "" if self.name == "shear" else f"; values that are closer (--{_OPTIONS[self.name]}) make shorter steps"
        )
        leg_name = ("loading", "unloading")[leg]
        return f"no equilibrium at {value:.4g} {CYCLED[self.name][1]}, {leg_name} of cycle {number}{option}"

    def _read(self, value: float, history: FabricHistory) -> Pair:
        return self.read(self.point(value, loaded_state(history)))

    def _cycle(self, number: int, legs: Sequence[Sequence[Sequence[tuple[Pair, float, bool]]]], stopped: str) -> Cycle:
        steps = [sum(1 + STEPS * len(side) for side in self.sides)] * 2
        whole = [sum(map(len, leg)) for leg in legs] == steps
        work = [
            sum(float(np.trapezoid([f for (_, f), _, _ in trace], [x for (x, _), _, _ in trace])) for trace in leg)
            * self.unit
            for leg in legs
        ]
        measured = [tuple(pair for trace in leg for pair, _, kept in trace if kept) for leg in legs]
        dissipated = sum(lost for leg in legs for trace in leg for _, lost, _ in trace)
        there, back, lost = (work[0], -work[1], dissipated) if whole else (math.nan,) * 3
        status = "converged" if whole else "stalled"
        where = "" if whole else stopped
        return Cycle(self.name, self.direction, number, measured[0], measured[1], there, back, lost, status, where)


def cycled_tests(
    fabric: HomogeneousFabric,
    directions: Sequence[float],
    loads: Sequence[float],
    curvature: str,
    curvatures: Sequence[float] | None,
) -> Iterator[CycledTest]:
    """Tension along directions [degrees], shear under the tension of KES, bending; arguments as of ``Programme``."""
    held = FLAT if curvature == "flat" else Prescribed()
    for direction in directions:
        angle = math.radians(direction)
        yield CycledTest(
            "tension", direction, (tuple(loads),),
            lambda load, angle=angle: under_loads(Loads.tension(angle, load), held),
            lambda load, state, direction=direction: tests.tension_point(direction, load, state),
            lambda point: (point.stretch, point.load), held,
        )  # fmt: skip
    angles, pull = tests.SHEAR_ANGLES, tests.SHEAR_TENSION
    pulls = tests.both_ways(pull, pull)
    yield CycledTest(
        "shear", 0.0, (angles, tuple(-a for a in angles)), lambda angle: under_loads(pulls, tests.sheared(angle)),
        lambda angle, state: tests.shear_point(angle, pull, state), lambda point: (point.angle, point.force),
        tests.sheared(0.0), pull, math.radians(1.0),
    )  # fmt: skip
    values = tests.default_curvatures(fabric) if curvatures is None else curvatures
    sides = tuple(tuple(sorted((v for v in values if side * v > 0), key=abs)) for side in (1.0, -1.0))
    for direction in tests.BENDING_DIRECTIONS:
        angle = math.radians(direction)
        yield CycledTest(
            "bending", direction, tuple(side for side in sides if side),
            lambda value, angle=angle: under_loads(Loads(), Prescribed.bent(angle, value)),
            lambda value, state, direction=direction: tests.bending_point(direction, value, state),
            lambda point: (point.curvature, point.moment), FLAT,
        )  # fmt: skip
