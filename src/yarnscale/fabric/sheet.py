"""Finite fabrics of yarns at full length: a pattern repeated, or lines of any kind (HYLC20 §8.1)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.errors import InputError
from yarnscale.yarn.frames import carried, reference_twist, unit, unit_edges, untwisted_frames
from yarnscale.yarn.pattern import YarnPattern
from yarnscale.yarn.strands import Strands

Shape = Callable[[Array], tuple[Array, Array]]
"""Points (n, 3) and rotations (n, 3, 3) at reference coordinates (n, 3) [m]."""

LARGEST_SHEET = 3_000_000
"""Most vertices of a sheet."""
NO_PATTERN = -1


@dataclass(frozen=True, eq=False)
class YarnSheet:
    """Yarns of finite length, vertex after vertex; quantities of an edge are stored at its first vertex.

    vertices: (n, 3) [m]. offsets: (c + 1,), yarn i owns the vertices offsets[i] … offsets[i + 1] − 1. closed: (c,)
    whether its last vertex joins the first; the last vertex of an open yarn has no edge, its entries count for nothing.
    twist (n,), rest_length (n,) [m], rest_curvature (n, 2), rest_twist (n,), reference_director (n, 3),
    reference_twist (n,): as in ``YarnPattern``. radius: [m]. yarn: (c,) number of each yarn in its pattern.
    source: (n,) vertex of the pattern, −1 of yarns that were added to it. tile: (n, 2) copy of the pattern.
    yarn_radius: (c,) radius of each yarn [m], None where all have ``radius``, which is the largest.
    yarn_material: (c,) number of each yarn's material. area: of the fabric at rest [m²]. name: a label.
    polyline: as in ``YarnPattern``.
    """

    vertices: Array
    offsets: Integers
    closed: Flags
    twist: Array
    rest_length: Array
    rest_curvature: Array
    rest_twist: Array
    reference_director: Array
    reference_twist: Array
    radius: float
    yarn: Integers
    source: Integers
    tile: Integers
    yarn_material: Integers
    area: float
    name: str = "sheet"
    size: tuple[float, float] = field(default=(0.0, 0.0))
    yarn_radius: Array | None = None
    polyline: bool = False

    # --- topology -------------------------------------------------------------------------------------

    @cached_property
    def strands(self) -> Strands:
        """Which segments follow each other."""
        return Strands.finite(self.offsets, self.closed)

    @property
    def following(self) -> Integers:
        """Vertex at the end of each vertex's edge (n,), −1 at the end of an open yarn."""
        return self.strands.ends

    @property
    def edges(self) -> Integers:
        """First vertices of all edges (m,)."""
        return self.strands.edges

    @property
    def yarn_of_vertex(self) -> Integers:
        """Index of each vertex's yarn in this sheet (n,)."""
        return self.strands.yarn

    @property
    def material_of_vertex(self) -> Integers:
        """Number of the material of each vertex's yarn (n,)."""
        return self.yarn_material[self.yarn_of_vertex]

    @property
    def relative_radius(self) -> Array:
        """Radius of each vertex's yarn over ``radius`` (n,)."""
        return (self.yarn_radii / self.radius)[self.yarn_of_vertex]

    @property
    def yarn_radii(self) -> Array:
        """Radius of each yarn (c,) [m]."""
        return np.full(len(self.closed), self.radius) if self.yarn_radius is None else self.yarn_radius

    @property
    def voronoi_length(self) -> Array:
        """Rest length that belongs to each vertex, half of its edges (n,) [m]."""
        own = np.where(self.following >= 0, self.rest_length, 0.0)
        before = np.where(self.strands.before >= 0, self.rest_length[self.strands.before], 0.0)
        return 0.5 * (own + before)

    @property
    def vertex_count(self) -> int:
        """Number of vertices."""
        return len(self.vertices)

    @property
    def unknowns(self) -> int:
        """Coordinates of vertices and twists of edges."""
        return 3 * len(self.vertices) + len(self.edges)

    @property
    def yarn_length(self) -> float:
        """Length of all yarns at rest [m]."""
        return float(self.rest_length[self.edges].sum())

    # --- makers ---------------------------------------------------------------------------------------

    @classmethod
    def of(cls, pattern: YarnPattern, columns: int, rows: int, *, tube: bool = False) -> YarnSheet:
        """``columns`` by ``rows`` periods of a pattern, cut straight at its borders.

        A yarn belongs to the fabric where the line around which it winds does, so that loops stay whole.
        tube: the yarns along x are closed, and the fabric is rolled up around the y axis.

        Raises InputError for numbers that are no fabric, and where a pattern cannot be made a tube.
        """
        for name, value in (("columns", columns), ("rows", rows)):
            if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
                raise InputError(f"{name} of a sheet", expected="a whole number of periods, 1 or more", found=value)
        found = columns * rows * len(pattern.edges)
        if found > LARGEST_SHEET:
            raise InputError("sheet is too large", expected=f"at most {LARGEST_SHEET} vertices", found=found)
        vertex, tile, lengths, closed = _lines(pattern, columns, rows, tube)
        if len(lengths) == 0:
            raise InputError(
                "no yarn of this pattern is long enough",
                expected="more columns or rows",
                found=(columns, rows),
            )
        offsets = np.concatenate([[0], np.cumsum(lengths)])
        size = columns * float(pattern.period[0]), rows * float(pattern.period[1])
        flat = replace(
            cls.of_vertices(pattern, vertex, tile, offsets, closed),
            area=size[0] * size[1], name=f"{pattern.name} {columns}×{rows}", size=size,
        )  # fmt: skip
        return flat._rolled(pattern) if tube else flat

    @classmethod
    def of_vertices(
        cls, pattern: YarnPattern, vertex: Integers, tile: Integers, offsets: Integers, closed: Flags
    ) -> YarnSheet:
        """Some vertices (n,) of a pattern in their tiles (n, 2), yarn after yarn, as they are drawn; area: 0."""
        positions = pattern.vertices[vertex].copy()
        positions[:, :2] += tile * pattern.period
        yarn = pattern.yarn_of_vertex[vertex[offsets[:-1]]]
        assert pattern.yarn_material is not None
        return cls(
            vertices=positions, offsets=offsets, closed=closed, twist=pattern.twist[vertex],
            rest_length=pattern.rest_length[vertex], rest_curvature=pattern.rest_curvature[vertex],
            rest_twist=pattern.rest_twist[vertex], reference_director=pattern.reference_director[vertex],
            reference_twist=pattern.reference_twist[vertex], radius=pattern.radius, yarn=yarn, source=vertex,
            tile=tile, yarn_material=pattern.yarn_material[yarn], area=0.0, name=pattern.name,
            yarn_radius=None if pattern.yarn_radius is None else pattern.yarn_radius[yarn],
            polyline=pattern.polyline,
        )  # fmt: skip

    @classmethod
    def filling(cls, pattern: YarnPattern, width: float, height: float) -> YarnSheet:
        """The sheet of whole periods nearest to width × height [m]; InputError for sizes below a period."""
        counts = []
        for name, size, period in zip(("width", "height"), (width, height), pattern.period, strict=True):
            if not (math.isfinite(size) and size >= period):
                raise InputError(f"{name} of a sheet", expected=f"at least one period of {period:g} m", found=size)
            counts.append(round(min(size / float(period), 1e7)))
        return cls.of(pattern, counts[0], counts[1])

    @classmethod
    def from_lines(
        cls,
        lines: Sequence[Array],
        radius: float,
        *,
        closed: bool = False,
        bent: bool = False,
        name: str = "yarns",
    ) -> YarnSheet:
        """Yarns along lines of points (k, 3) [m], which are also their rest shape.

        bent: with the present curvature as rest curvature; by default yarns are straight at rest. Raises InputError.
        """
        for index, line in enumerate(lines):
            shape = np.shape(line)
            if len(shape) != 2 or shape[1] != 3 or shape[0] < (3 if closed else 2) or not np.isfinite(line).all():
                raise InputError(f"line {index}", expected="finite points, shape (k, 3)", found=shape)
        if not lines or not (math.isfinite(radius) and radius > 0):
            raise InputError("yarns", expected="at least one line, a positive radius", found=(len(lines), radius))
        counts = np.array([len(line) for line in lines])
        n, offsets = int(counts.sum()), np.concatenate([[0], np.cumsum(counts)])
        whole = np.ones(len(lines), bool) if closed else np.zeros(len(lines), bool)
        zero, own = np.zeros(n), np.arange(len(lines))
        sheet = cls(
            vertices=np.concatenate([np.asarray(line, np.float64) for line in lines]), offsets=offsets,
            closed=whole, twist=zero, rest_length=zero + 1.0, rest_curvature=np.zeros((n, 2)), rest_twist=zero,
            reference_director=np.zeros((n, 3)), reference_twist=zero, radius=float(radius), yarn=own,
            source=np.full(n, NO_PATTERN), tile=np.zeros((n, 2), np.int64),
            yarn_material=np.zeros(len(lines), np.int64), area=0.0, name=name,
        )  # fmt: skip
        strands = sheet.strands
        director, twist, curvature, length = untwisted_frames(
            sheet.vertices, strands.ends, strands.before, np.flatnonzero(strands.place == 0)
        )
        return replace(
            sheet,
            reference_director=director,
            reference_twist=twist,
            rest_length=length,
            rest_curvature=curvature if bent else sheet.rest_curvature,
            rest_twist=twist.copy() if bent else zero,
        )

    def joined(self, other: YarnSheet) -> YarnSheet:
        """Both fabrics as one; radius, area and size are this one's."""
        if other.radius != self.radius or self.yarn_radius is not None or other.yarn_radius is not None:
            raise InputError("radius of yarns to join", expected=self.radius, found=other.yarn_radii)
        arrays = (
            "vertices", "closed", "twist", "rest_length", "rest_curvature", "rest_twist", "reference_director",
            "reference_twist", "yarn", "source", "tile", "yarn_material",
        )  # fmt: skip
        both = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in arrays}
        offsets = np.concatenate([self.offsets, self.offsets[-1] + other.offsets[1:]])
        return replace(self, offsets=offsets, **both)

    # --- changed copies -------------------------------------------------------------------------------

    def moved(
        self,
        positions: Array,
        *,
        twist: Array | None = None,
        rotations: Array | None = None,
        tangents: Array | None = None,
    ) -> YarnSheet:
        """The sheet in another shape, frames transported with the edges; the rest shape stays.

        positions: (n, 3) [m]. rotations: (n, 3, 3) by which the frames turn first; by default they turn as little as
        the edges need. tangents: (n, 3) of the edges now, where yarns close only in the new shape.
        """
        start = unit_edges(self.vertices, self.following) if tangents is None else tangents
        director = self.reference_director
        if rotations is not None:
            start = np.einsum("nij,nj->ni", rotations, start)
            director = np.einsum("nij,nj->ni", rotations, director)
        end = unit_edges(positions, self.following)
        director = carried(start, end, director)
        reference = reference_twist(end, director, self.strands.before, self.reference_twist)
        return replace(
            self,
            vertices=np.array(positions, np.float64),
            reference_director=director,
            reference_twist=reference,
            twist=self.twist if twist is None else twist,
        )

    def shaped(self, shape: Shape) -> YarnSheet:
        """The sheet laid on a surface: vertices and frames follow the map of reference coordinates."""
        positions, rotations = shape(self.vertices)
        return self.moved(positions, rotations=rotations)

    def _rolled(self, pattern: YarnPattern) -> YarnSheet:
        edge = pattern.edge_vectors()[self.source]
        radius = self.size[0] / (2.0 * math.pi)

        def tube(reference: Array) -> tuple[Array, Array]:
            angle, out = reference[:, 0] / radius, radius + reference[:, 2]
            sine, cosine, zero = np.sin(angle), np.cos(angle), np.zeros(len(angle))
            points = np.stack([out * sine, reference[:, 1], out * cosine], 1)
            rows = [[cosine, zero, sine], [zero, zero + 1.0, zero], [-sine, zero, cosine]]
            return points, np.moveaxis(np.array(rows), 2, 0)

        positions, rotations = tube(self.vertices)
        return self.moved(positions, rotations=rotations, tangents=unit(edge))


def _lines(pattern: YarnPattern, columns: int, rows: int, tube: bool) -> tuple[Integers, Integers, Integers, Flags]:
    """Vertices and tiles of all yarns of the sheet in order, lengths of yarns, whether they are closed."""
    size = np.array([columns, rows]) * pattern.period
    count = np.array([columns, rows])
    vertices, tiles, lengths, closed = [], [], [], []
    for index, chain in enumerate(pattern.yarns):
        length, shift = len(chain), pattern.yarn_shift[index]
        around = bool(tube and shift[0])
        if around and (abs(shift[0]) != 1 or shift[1]):
            raise InputError(
                "pattern for a tube",
                expected="yarns along x that move one period at a time",
                found=shift.tolist(),
            )
        walked = pattern.tile_along_yarn[chain]
        points = pattern.vertices[chain, :2] + walked * pattern.period
        pace = shift * pattern.period / length
        # The straight line around which the yarn winds: base + k · pace at its k-th vertex.
        base = (points - np.arange(length)[:, None] * pace).mean(axis=0)
        for start in _starts(base, pattern.period, count, shift, size):
            first, last = _inside(base + start * pattern.period, pace, size, length if not shift.any() else None)
            steps = np.arange(first, last)
            if around and last > first:
                steps = np.arange(first, first + columns * length)
            if len(steps) < 3:
                continue
            turn, place = np.divmod(steps, length)
            vertices.append(chain[place])
            tiles.append(walked[place] + turn[:, None] * shift + start)
            lengths.append(len(steps))
            closed.append(around or not shift.any())
    if not lengths:
        return np.empty(0, np.int64), np.empty((0, 2), np.int64), np.empty(0, np.int64), np.empty(0, bool)
    return np.concatenate(vertices), np.concatenate(tiles), np.array(lengths), np.array(closed)


def _starts(base: Array, period: Array, count: Integers, shift: Integers, size: Array) -> list[Integers]:
    """Tiles of those copies of a yarn that may pass through the sheet, every endless line once."""
    reach = np.abs(shift)
    low = np.floor(-base / period).astype(int) - reach
    high = np.ceil((size - base) / period).astype(int) + reach
    found, seen = [], set()
    span = int(count.max()) + int(reach.max()) + 2
    for a in range(low[0], high[0] + 1):
        for b in range(low[1], high[1] + 1):
            if (a, b) in seen:
                continue
            if shift.any():
                seen.update((a + k * int(shift[0]), b + k * int(shift[1])) for k in range(-2 * span, 2 * span))
            found.append(np.array([a, b]))
    return found


def _inside(base: Array, pace: Array, size: Array, whole: int | None) -> tuple[int, int]:
    """First vertex of a line base + k·pace in the rectangle, and the first one behind it; ``whole``: of a ring."""
    low, high = -math.inf, math.inf
    for c in range(2):
        if pace[c] == 0.0:
            if not 0.0 <= base[c] < size[c]:
                return 0, 0
            continue
        ends = sorted((-base[c] / pace[c], (size[c] - base[c]) / pace[c]))
        low, high = max(low, ends[0]), min(high, ends[1])
    if whole is not None:
        return 0, whole
    # Rounding must not add a vertex to one row and not to others.
    return (math.ceil(low - 1e-9), math.ceil(high - 1e-9)) if high > low else (0, 0)
