"""Yarns on a moving cloth: laid out once, placed in every frame.

A yarn vertex with reference coordinates (ξ, h) is at

    x = φ(ξ) + Q(ξ) (û + h e3),

as in the cell (theory §2, C1), with the cloth's surface φ for the cell's, and Q, whose columns are ∂φ/∂ξ · I^(−1/2) and
the normal, for R. On a uniformly stretched or cylindrically bent cloth this is the cell's own equilibrium. All
terms are continuous across triangles, and so are the yarns.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numba
import numpy as np

from yarnscale.arrays import Array
from yarnscale.detail.fluctuations import FluctuationTable, fluctuation
from yarnscale.detail.joins import sewn_layout
from yarnscale.detail.surface import SurfaceFit
from yarnscale.detail.tiling import YarnLayout
from yarnscale.errors import InputError
from yarnscale.shell.mesh import TriangleMesh

Seams = Literal["joined", "cut"]

_CRUSHED = 1e-6
"""Area over rest area below which the normal of the triangle replaces that of the surface."""


@dataclass(frozen=True, eq=False)
class YarnDetail:
    """The yarns of a cloth: fluctuations of the pattern, its layout on the mesh, and the fit of the mesh's surface."""

    table: FluctuationTable
    mesh: TriangleMesh
    layout: YarnLayout
    surface: SurfaceFit

    @classmethod
    def of(cls, table: FluctuationTable, mesh: TriangleMesh, *, seams: Seams = "joined") -> YarnDetail:
        """Lay the table's pattern over a mesh, its yarns joined across seams or cut there.

        Raises InputError if no yarn fits on any panel.
        """
        if seams not in get_args(Seams):
            raise InputError("yarns at seams", expected=" or ".join(get_args(Seams)), found=seams)
        lay = sewn_layout if seams == "joined" else YarnLayout.of
        return cls(table, mesh, lay(table.pattern, mesh), SurfaceFit.of(mesh))

    @property
    def radius(self) -> float:
        """Radius of the yarns [m]."""
        return self.table.pattern.radius

    def curves(self, positions: Array) -> Array:
        """Yarn vertices [m], shape (n, 3) in the order of ``layout``, of the mesh deformed to positions (nv, 3) [m].

        Raises InputError for positions of another mesh or that are not finite.
        """
        return self._placed(positions)[0]

    def states(self, positions: Array) -> Array:
        """(s_x, s_a, s_y, II11, II22) [-, 1/m] at every yarn vertex, shape (n, 5); arguments as for ``curves``."""
        return self._placed(positions)[1]

    def _placed(self, positions: Array) -> tuple[Array, Array]:
        positions = np.ascontiguousarray(positions, dtype=np.float64)
        if positions.shape != (self.mesh.vertex_count, 3):
            raise InputError("positions of the cloth", expected=(self.mesh.vertex_count, 3), found=positions.shape)
        if not np.isfinite(positions).all():
            raise InputError("positions of the cloth", expected="finite numbers", found="others")
        gradient, first, second = self.surface.forms(positions)
        mesh, layout, table = self.mesh, self.layout, self.table
        points, states = _place(
            positions, mesh.triangles, mesh.corners, mesh.material, gradient, first, second, layout.triangle,
            layout.place, layout.material, layout.stretch, layout.vertex, table.pattern.vertices, table.axes,
            table.values,
        )  # fmt: skip
        layout.bridges.place(points)
        return points, states


@numba.njit(cache=True, error_model="numpy")
def _place(
    positions, triangles, corners, material, gradient, first, second, triangle, place, xi, stretch, vertex, rest, axes,
    values,
):  # fmt: skip
    """Positions (n, 3) and states (n, 5) of yarn vertices."""
    count = len(triangle)
    out, states = np.empty((count, 3)), np.empty((count, 5))
    surface, slope, moved = np.empty(3), np.empty((2, 3)), np.empty(3)
    for k in range(count):
        t = triangle[k]
        _surface_at(positions, triangles[t], corners[t], material, gradient, place[k], xi[k], surface, slope)
        a, b = slope[0], slope[1]
        # From here on by coordinates of the pattern, ξ over its stretch.
        a *= stretch[k, 0]
        b *= stretch[k, 1]
        n0, n1, n2 = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
        area = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
        if area < _CRUSHED:
            _facet(positions, triangles[t], corners[t], material, slope)
            a *= stretch[k, 0]
            b *= stretch[k, 1]
            n0, n1, n2 = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
            area = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
        long_a = np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
        long_b = np.sqrt(b[0] * b[0] + b[1] * b[1] + b[2] * b[2])
        if area <= 1e-12 * long_a * long_b or long_a == 0.0 or long_b == 0.0:
            # Crushed to a line: no frame, no detail; the yarn stays on the surface.
            out[k] = surface
            states[k] = 0.0
            continue
        n0, n1, n2 = n0 / area, n1 / area, n2 / area
        along = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
        state = states[k]
        _strain(first, second, corners[t], place[k], stretch[k], state)
        fluctuation(values, axes, state, vertex[k], moved)
        # In the frame (t, n × t), t = a/|a|, the gradient is upper triangular; its polar rotation has this angle.
        m11, m12, m22 = long_a, along / long_a, area / long_a
        size = np.sqrt((m11 + m22) ** 2 + m12 * m12)
        cosine, sine = (m11 + m22) / size, -m12 / size
        side = cosine * moved[0] - sine * moved[1]
        other = sine * moved[0] + cosine * moved[1]
        height = rest[vertex[k], 2] + moved[2]
        t0, t1, t2 = a[0] / long_a, a[1] / long_a, a[2] / long_a
        out[k, 0] = surface[0] + side * t0 + other * (n1 * t2 - n2 * t1) + height * n0
        out[k, 1] = surface[1] + side * t1 + other * (n2 * t0 - n0 * t2) + height * n1
        out[k, 2] = surface[2] + side * t2 + other * (n0 * t1 - n1 * t0) + height * n2
    return out, states


@numba.njit(cache=True, inline="always")
def _surface_at(positions, vertices, points, material, gradient, place, xi, surface, slope):
    """φ into ``surface`` (3,) and the interpolated ∂φ/∂ξ into ``slope`` (2, 3)."""
    surface[:] = 0.0
    slope[:] = 0.0
    for c in range(3):
        share, p = place[c], points[c]
        du, dv = 0.5 * (xi[0] - material[p, 0]), 0.5 * (xi[1] - material[p, 1])
        for d in range(3):
            own, other = gradient[p, 0, d], gradient[p, 1, d]
            surface[d] += share * (positions[vertices[c], d] + own * du + other * dv)
            slope[0, d] += share * own
            slope[1, d] += share * other


@numba.njit(cache=True, error_model="numpy", inline="always")
def _strain(first, second, points, place, stretch, state):
    """Interpolated (s_x, s_a, s_y, II11, II22) of a pattern that lies stretched, into ``state`` (5,)."""
    xx = xy = yy = bend_x = bend_y = 0.0
    for c in range(3):
        p = points[c]
        xx += place[c] * first[p, 0]
        xy += place[c] * first[p, 1]
        yy += place[c] * first[p, 2]
        bend_x += place[c] * second[p, 0]
        bend_y += place[c] * second[p, 2]
    long_x, long_y = np.sqrt(max(xx, 0.0)), np.sqrt(max(yy, 0.0))
    product = long_x * long_y
    state[0], state[2] = long_x * stretch[0] - 1.0, long_y * stretch[1] - 1.0
    state[1] = xy / product if product > 0.0 else 0.0
    state[3], state[4] = bend_x * stretch[0] ** 2, bend_y * stretch[1] ** 2


@numba.njit(cache=True)
def _facet(positions, vertices, points, material, slope):
    """∂φ/∂ξ of the flat triangle, into ``slope`` (2, 3)."""
    u0, u1 = material[points[1], 0] - material[points[0], 0], material[points[1], 1] - material[points[0], 1]
    v0, v1 = material[points[2], 0] - material[points[0], 0], material[points[2], 1] - material[points[0], 1]
    inverse = 1.0 / (u0 * v1 - u1 * v0)
    for d in range(3):
        e = positions[vertices[1], d] - positions[vertices[0], d]
        f = positions[vertices[2], d] - positions[vertices[0], d]
        slope[0, d] = (e * v1 - f * u1) * inverse
        slope[1, d] = (f * u0 - e * v0) * inverse
