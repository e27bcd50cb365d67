"""The rest geometry of one period of a knitted or woven fabric."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from yarnscale.errors import InputError
from yarnscale.yarn.frames import curve_length
from yarnscale.yarn.pattern_fields import (
    LARGEST_LENGTH,
    check_angle,
    check_length,
    edge_array,
    first_true,
    float_array,
    material_array,
    radius_array,
)

DIRECTOR_TOLERANCE = 1e-3
"""Largest deviation of a reference director from unit length and from a right angle with its edge."""
LARGEST_RADIUS_OVER_PERIOD = 10.0
LARGEST_REPEATED = 2_000_000
"""Vertices of a pattern repeated over tiles."""


@dataclass(frozen=True, eq=False)
class YarnPattern:
    """One period of a fabric at rest: closed periodic yarns as discrete elastic rods (HYLC20 §5).

    x is the course (weft) direction, y the wale (warp) direction, z the thickness. Every vertex has one
    incoming and one outgoing edge, so there are as many edges as vertices, and **every quantity of an edge
    is stored at the index of the edge's first vertex**: ``edges[i, 0] == i``. Quantities of a joint (rest
    curvature, rest twist, reference twist) belong to the vertex between the incoming and the outgoing edge.

    vertices: positions, shape (n, 3) [m].
    twist: angle θ of the material frame from the reference frame, per edge, shape (n,) [rad].
    edges: rows (v0, v1, dx, dy), shape (n, 4); the second end is ``vertices[v1] + (dx px, dy py, 0)``.
    rest_length: per edge, shape (n,) [m].
    rest_curvature: integrated material curvatures (κ¹, κ²) per vertex, shape (n, 2) [-].
    rest_twist: integrated twist per vertex, shape (n,) [rad].
    reference_director: d1, a unit vector at a right angle to the edge, per edge, shape (n, 3).
    reference_twist: signed angle about the outgoing tangent from the transported d1 of the incoming edge to the d1 of
        the outgoing edge, per vertex, shape (n,) [rad].
    period: (px, py), shape (2,) [m].
    radius: yarn radius [m], of the thickest yarn where there are several.
    name: a label; not part of the content.
    yarn_material: number of each yarn's material (0 is the first), in the order of `yarns`, shape (yarns,);
        None: all are 0.
    yarn_radius: radius of each yarn [m], shape (yarns,); None where all have ``radius``.
    polyline: whether yarns are the straight segments between their vertices, as in the published patterns, with the
        published convention of contact, or smooth curves (theory §1).

    Raises InputError with the field for invalid shapes, values or topology. Arrays are read-only:
    `dataclasses.replace` and the methods below return changed copies.
    """

    vertices: np.ndarray
    twist: np.ndarray
    edges: np.ndarray
    rest_length: np.ndarray
    rest_curvature: np.ndarray
    rest_twist: np.ndarray
    reference_director: np.ndarray
    reference_twist: np.ndarray
    period: np.ndarray
    radius: float
    name: str = "pattern"
    yarn_material: np.ndarray | None = None
    yarn_radius: np.ndarray | None = None
    polyline: bool = False

    def __post_init__(self) -> None:
        """Store contiguous arrays of the right type and check everything that can be checked cheaply."""
        vertices = np.asarray(self.vertices)
        n = vertices.shape[0] if vertices.ndim == 2 else 0
        if n == 0:
            raise InputError("vertices must be a non-empty table", expected="shape (n, 3)", found=vertices.shape)
        shapes = {
            "vertices": (n, 3),
            "twist": (n,),
            "rest_length": (n,),
            "rest_curvature": (n, 2),
            "rest_twist": (n,),
            "reference_director": (n, 3),
            "reference_twist": (n,),
            "period": (2,),
        }
        for field, shape in shapes.items():
            object.__setattr__(self, field, float_array(field, getattr(self, field), shape))
        object.__setattr__(self, "edges", edge_array(self.edges, n))
        object.__setattr__(self, "radius", float(self.radius))
        object.__setattr__(self, "yarn_material", material_array(self.yarn_material, len(self.yarns)))
        object.__setattr__(self, "yarn_radius", radius_array(self.yarn_radius, self.radius, len(self.yarns)))
        self._check_values()

    def __repr__(self) -> str:
        x, y = 1e3 * self.period
        counts = f"{len(self.yarns)} yarns, {len(self.edges)} vertices"
        size = f"period {x:.4g} × {y:.4g} mm, yarn radius {1e3 * self.radius:.3g} mm"
        return f"YarnPattern('{self.name}': {counts}, {size})"

    def _check_values(self) -> None:
        check_length("radius", np.array([self.radius]))
        check_length("period", self.period)
        check_length("rest_length", self.rest_length)
        for field in ("twist", "rest_curvature", "rest_twist", "reference_twist"):
            check_angle(field, getattr(self, field))
        if np.abs(self.vertices).max() > LARGEST_LENGTH:
            raise InputError("vertices lie too far out", expected=f"metres, below {LARGEST_LENGTH:g}")
        if self.radius > LARGEST_RADIUS_OVER_PERIOD * self.period.min():
            raise InputError(
                "radius is too large for the period",
                expected=f"at most {LARGEST_RADIUS_OVER_PERIOD:g} times the smaller period {self.period.min():g} m",
                found=f"{self.radius:g} m",
            )
        edge = self.edge_vectors()
        length = np.linalg.norm(edge, axis=1)
        if (bad := first_true(~((length > 0.0) & (length < LARGEST_LENGTH)))) is not None:
            raise InputError(
                f"edges[{bad}] has no usable length", expected="two distinct ends", found=f"{length[bad]:g} m"
            )
        director = self.reference_director
        if (bad := first_true(np.abs(director).max(axis=1) > 2.0)) is not None:
            raise InputError(f"reference_director[{bad}] must be a unit vector", expected="length 1")
        off = np.abs(np.linalg.norm(director, axis=1) - 1.0)
        lean = np.abs(np.einsum("ij,ij->i", director, edge)) / length
        if (bad := first_true(off > DIRECTOR_TOLERANCE)) is not None:
            raise InputError(
                f"reference_director[{bad}] must be a unit vector",
                expected="length 1",
                found=f"length {np.linalg.norm(director[bad]):.6g}",
            )
        if (bad := first_true(lean > DIRECTOR_TOLERANCE)) is not None:
            raise InputError(
                f"reference_director[{bad}] must be perpendicular to its edge",
                expected="cosine 0",
                found=f"cosine {lean[bad]:.3g}",
            )

    # --- topology -------------------------------------------------------------------------------------

    @property
    def next_vertex(self) -> np.ndarray:
        """The vertex at the end of each vertex's outgoing edge, shape (n,)."""
        return self.edges[:, 1]

    @cached_property
    def previous_vertex(self) -> np.ndarray:
        """The vertex at the start of each vertex's incoming edge, shape (n,)."""
        previous = np.empty(len(self.edges), dtype=np.int64)
        previous[self.edges[:, 1]] = self.edges[:, 0]
        return previous

    @cached_property
    def yarns(self) -> list[np.ndarray]:
        """Vertex indices in order along each closed periodic yarn; yarns start at their lowest index."""
        following = self.next_vertex.tolist()
        seen = [False] * len(following)
        yarns = []
        for start in range(len(following)):
            if seen[start]:
                continue
            chain, vertex = [], start
            while not seen[vertex]:
                seen[vertex] = True
                chain.append(vertex)
                vertex = following[vertex]
            yarns.append(np.array(chain, dtype=np.int64))
        return yarns

    @cached_property
    def yarn_of_vertex(self) -> np.ndarray:
        """Index of each vertex's yarn in `yarns`, shape (n,)."""
        owner = np.empty(len(self.edges), dtype=np.int64)
        for index, chain in enumerate(self.yarns):
            owner[chain] = index
        return owner

    @cached_property
    def position_along_yarn(self) -> np.ndarray:
        """Number of edges from the yarn's first vertex to each vertex, shape (n,)."""
        position = np.empty(len(self.edges), dtype=np.int64)
        for chain in self.yarns:
            position[chain] = np.arange(len(chain))
        return position

    @cached_property
    def tile_along_yarn(self) -> np.ndarray:
        """Tile reached by walking from the yarn's first vertex to each vertex, shape (n, 2).

        ``vertices[v] + tile_along_yarn[v] * period`` is continuous along the yarn.
        """
        tile = np.zeros((len(self.edges), 2), dtype=np.int64)
        for chain in self.yarns:
            tile[chain[1:]] = np.cumsum(self.edges[chain[:-1], 2:], axis=0)
        return tile

    @cached_property
    def yarn_shift(self) -> np.ndarray:
        """Net tile shift (dx, dy) of each yarn over one period, shape (yarns, 2)."""
        return np.array([self.edges[chain, 2:].sum(axis=0) for chain in self.yarns], dtype=np.int64)

    @cached_property
    def material_of_vertex(self) -> np.ndarray:
        """Number of the material of each vertex's (and its outgoing edge's) yarn, shape (n,)."""
        assert self.yarn_material is not None
        return self.yarn_material[self.yarn_of_vertex]

    @cached_property
    def woven(self) -> bool:
        """Whether yarns run in two directions (warp and weft); those of a knit run in one."""
        return bool(np.linalg.matrix_rank(self.yarn_shift) == 2)

    @cached_property
    def relative_radius(self) -> np.ndarray:
        """Radius of each vertex's yarn over ``radius``, shape (n,)."""
        if self.yarn_radius is None:
            return np.ones(len(self.edges))
        return (self.yarn_radius / self.radius)[self.yarn_of_vertex]

    # --- geometry -------------------------------------------------------------------------------------

    @property
    def area(self) -> float:
        """Reference area of one period [m²]."""
        return float(self.period[0] * self.period[1])

    @cached_property
    def voronoi_length(self) -> np.ndarray:
        """Rest length that belongs to each vertex, half of its two edges, shape (n,) [m]."""
        return 0.5 * (self.rest_length[self.previous_vertex] + self.rest_length)

    def edge_vectors(self) -> np.ndarray:
        """Vector along each edge, shape (n, 3) [m]."""
        edge = self.vertices[self.edges[:, 1]] - self.vertices
        edge[:, :2] += self.edges[:, 2:] * self.period
        return edge

    @property
    def drawn_length(self) -> np.ndarray:
        """Length of yarn along each edge as drawn, of the smooth curve unless yarns are polylines, shape (n,) [m]."""
        if self.polyline:
            return np.linalg.norm(self.edge_vectors(), axis=1)
        return curve_length(self.edge_vectors(), self.previous_vertex, self.next_vertex)

    # --- changed copies -------------------------------------------------------------------------------

    def repeated(self, courses: int, wales: int) -> YarnPattern:
        """The same fabric described by a period of ``courses`` by ``wales`` tiles along x and y.

        Vertex i of tile (a, b) gets the index ``(a * wales + b) * n + i``. The energy per area is the same.
        """
        if courses < 1 or wales < 1:
            raise InputError("the numbers of tiles must be positive", expected="≥ 1", found=(courses, wales))
        n = len(self.edges)
        if courses * wales * n > LARGEST_REPEATED:
            expected = f"at most {LARGEST_REPEATED} vertices"
            raise InputError("too many tiles", expected=expected, found=f"{courses * wales * n}")
        tiles = np.stack(np.meshgrid(np.arange(courses), np.arange(wales), indexing="ij"), -1).reshape(-1, 2)
        count = np.array([courses, wales])
        vertices = np.tile(self.vertices, (len(tiles), 1, 1))
        vertices[:, :, :2] += (tiles * self.period)[:, None, :]
        target = tiles[:, None, :] + self.edges[None, :, 2:]
        shift, inside = np.divmod(target, count)
        edges = np.empty((len(tiles), n, 4), dtype=np.int64)
        edges[:, :, 0] = np.arange(len(tiles) * n).reshape(-1, n)
        edges[:, :, 1] = (inside[..., 0] * wales + inside[..., 1]) * n + self.edges[None, :, 1]
        edges[:, :, 2:] = shift

        def tiled(array: np.ndarray) -> np.ndarray:
            return np.tile(array, (len(tiles),) + (1,) * (array.ndim - 1))

        copied = ("twist", "rest_length", "rest_curvature", "rest_twist", "reference_director", "reference_twist")
        repeated = replace(
            self,
            vertices=vertices.reshape(-1, 3),
            edges=edges.reshape(-1, 4),
            period=self.period * count,
            name=self.name if courses * wales == 1 else f"{self.name}-{courses}x{wales}",
            yarn_material=None,
            yarn_radius=None,
            **{name: tiled(getattr(self, name)) for name in copied},
        )
        first = [chain[0] for chain in repeated.yarns]
        radius = None if self.yarn_radius is None else tiled(self.yarn_radius[self.yarn_of_vertex])[first]
        return replace(repeated, yarn_material=tiled(self.material_of_vertex)[first], yarn_radius=radius)

    def shifted(self, dx: float, dy: float) -> YarnPattern:
        """The pattern moved by (dx, dy) in the plane [m]."""
        return replace(self, vertices=self.vertices + np.array([dx, dy, 0.0]))

    def retiled(self, tiles: np.ndarray) -> YarnPattern:
        """The same fabric with each vertex v stored by its copy in tile ``tiles[v]``, shape (n, 2)."""
        tiles = np.broadcast_to(np.asarray(tiles, dtype=np.int64), (len(self.edges), 2))
        vertices, edges = self.vertices.copy(), self.edges.copy()
        vertices[:, :2] += tiles * self.period
        edges[:, 2:] += tiles - tiles[self.edges[:, 1]]
        return replace(self, vertices=vertices, edges=edges)

    def wrapped(self) -> YarnPattern:
        """The same fabric with every stored vertex inside [0, px) × [0, py)."""
        return self.retiled(-np.floor(self.vertices[:, :2] / self.period).astype(np.int64))

    def scaled(self, factor: float) -> YarnPattern:
        """The pattern with all lengths multiplied; integrated curvatures and twists stay as they are."""
        lengths = ["vertices", "rest_length", "period", "radius"] + ["yarn_radius"] * (self.yarn_radius is not None)
        return replace(self, **{name: getattr(self, name) * factor for name in lengths})

    def content_hash(self) -> str:
        """SHA-256 (hex) of everything except the name; the same on every machine."""
        digest = hashlib.sha256(b"yarnscale-pattern-1")
        digest.update(np.array([len(self.edges)], dtype="<i8").tobytes())
        digest.update(np.ascontiguousarray(self.edges, dtype="<i8").tobytes())
        for array in (
            self.vertices, self.twist, self.rest_length, self.rest_curvature, self.rest_twist, self.reference_director,
            self.reference_twist, self.period, np.array([self.radius]),
        ):  # fmt: skip
            # Adding zero turns -0.0 into 0.0: equal numbers, equal bytes.
            digest.update(np.ascontiguousarray(array + 0.0, dtype="<f8").tobytes())
        if self.material_of_vertex.any():
            # Patterns of one material keep the hash that they had before there were several.
            digest.update(np.ascontiguousarray(self.yarn_material, dtype="<i8").tobytes())
        if self.yarn_radius is not None:
            digest.update(np.ascontiguousarray(self.yarn_radius, dtype="<f8").tobytes())
        if not self.polyline:
            digest.update(b"smooth")
        return digest.hexdigest()
