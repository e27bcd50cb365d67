"""One period of a fabric of spline yarns, with copies of its control points wherever it is continued or touched."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from yarnscale.arrays import Array, Integers
from yarnscale.fabric.bspline import ORDER, blending


@dataclass(frozen=True, eq=False)
class SplinePeriod:
    """The segments and stitches of one period.

    width, height: of the period [m]. source: (m,) which of the ``count`` control points of the period each node copies;
    reference: (m, 3) its place in the flat period [m], around the origin in x and y, since the surface of a cell that
    bends both ways is exact only there. segments: (s, 4) nodes. stitches: (k, 2, 4) nodes at both points of every
    contact; weights, slopes: (k, 2, 4) that give positions and derivatives by the curve parameter. courses: of the
    period, ``count / courses`` control points each.
    """

    width: float
    height: float
    courses: int
    source: Integers
    reference: Array
    segments: Integers
    stitches: Integers
    weights: Array
    slopes: Array

    @property
    def count(self) -> int:
        """Control points of the period."""
        return len(self.segments)

    @property
    def area(self) -> float:
        """Area of the period [m²]."""
        return self.width * self.height

    @classmethod
    def of(cls, loops: list[Array], lap: Array, height: float, crossings: list[tuple[Array, Array]]) -> SplinePeriod:
        """loops: control points of every course, periodic up to ``lap`` (3,) [m]; crossings: of every course places on
        it and on the course below, which for the first is the last of the period below.
        """
        per_course, known, places = len(loops[0]), {}, []

        def node(course: int, knot: int, below: int) -> int:
            key = course, knot, below
            if key not in known:
                known[key] = len(places)
                place = loops[course][knot % per_course] + knot / per_course * lap - [0.0, below * height, 0.0]
                places.append((course * per_course + knot % per_course, place))
            return known[key]

        def four(course: int, segment: int, below: int = 0) -> list[int]:
            return [node(course, segment - 1 + k, below) for k in range(ORDER)]

        segments = [four(course, begin) for course in range(len(loops)) for begin in range(per_course)]
        stitches, along = [], []
        for course, (own, other) in enumerate(crossings):
            for low, high in zip(own, other, strict=True):
                first, second = int(np.floor(low)), int(np.floor(high))
                below = (course - 1) % len(loops)
                stitches.append([four(course, first), four(below, second, 0 if course else 1)])
                along.append([low - first, high - second])
        reference = np.array([place for _, place in places])
        reference[:, :2] -= 0.5 * (reference.min(axis=0) + reference.max(axis=0))[:2]
        return cls(
            float(lap[0]), height, len(loops), np.array([source for source, _ in places]), reference,
            np.array(segments), np.array(stitches),
            blending(np.array(along)), blending(np.array(along), 1),
        )  # fmt: skip

    def with_copies(self, tiles: Integers, segments: Integers) -> tuple[SplinePeriod, Integers]:
        """With the nodes of some segments of copies, numbered tile after tile of (t, 2); and nodes of all (t·s, 4).

        Those of other segments than these are −1.
        """
        size, first = np.array([self.width, self.height]), np.unique(self.source, return_index=True)[1]
        own = np.round((self.reference - self.reference[first[self.source]])[:, :2] / size).astype(np.int64)
        tile, segment = np.divmod(segments, len(self.segments))
        nodes = self.segments[segment]
        wanted = np.concatenate([self.source[nodes][..., None], own[nodes] + tiles[tile][:, None]], axis=2)
        keys = np.concatenate([np.column_stack([self.source, own]), wanted.reshape(-1, 3)])
        _, where, which = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        which, known = which.ravel(), len(self.source)
        number = np.full(len(where), -1)
        number[which[:known]] = np.arange(known)
        new = np.flatnonzero(number < 0)
        number[new] = known + np.arange(len(new))
        source, shift = keys[where[new], 0], keys[where[new], 1:] * size
        places = self.reference[first[source]] + np.column_stack([shift, np.zeros(len(new))])
        grown = replace(
            self, source=np.concatenate([self.source, source]), reference=np.concatenate([self.reference, places])
        )
        copies = np.full((len(tiles) * len(self.segments), ORDER), -1)
        copies[segments] = number[which[known:]].reshape(-1, ORDER)
        return grown, copies

    def sources(self, yarns: int, points: int, first_course: int) -> Integers:
        """Which control point of the period each of a fabric's (yarns, points) corresponds to, (yarns · points,)."""
        per_course = self.count // self.courses
        course = (first_course + np.arange(yarns)[:, None]) % self.courses
        return (course * per_course + (np.arange(points) - 1) % per_course).ravel()
