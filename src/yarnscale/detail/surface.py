"""A smooth surface through the vertices of a deformed mesh, with its first and second derivatives.

At every vertex, a quadratic in the material coordinates ξ is fitted to the vertices around it (weighted least squares,
through the vertex itself). The fit is linear in positions, so its weights are found once. Between vertices,

    φ(ξ) = Σ_v λ_v(ξ) (x_v + ½ A_v (ξ − ξ_v)),   A(ξ) = Σ_v λ_v A_v,   I(ξ) = Σ_v λ_v I_v,   II(ξ) = Σ_v λ_v II_v,

λ the barycentric coordinates and A_v the fitted ∂φ/∂ξ. φ reproduces every quadratic exactly, on any mesh; φ, A, I and
II are continuous across triangles, since on an edge only its two ends contribute. A is used for directions only: where
cloth rolls up within a few triangles, the fit cuts through the roll, which would appear as compression. So I_v is the
mean of the metrics of the triangles around a vertex.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from scipy import sparse

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.shell.mesh import TriangleMesh

_REGULAR = 1e-4
"""Least eigenvalue of a fit's normal matrix, over its largest, that counts as determined (lengths in edge lengths)."""
_MOST_RINGS = 4


@dataclass(frozen=True, eq=False)
class SurfaceFit:
    """Weights of the fits at the material points of a mesh; across a seam each panel has its own.

    Entries start[p] … start[p + 1] belong to point p: neighbour, (k,) mesh vertices, and weights, (k, 5), which sum
    their x − x_p to φ,1 φ,2 φ,11 φ,12 φ,22 at the point.
    """

    mesh: TriangleMesh
    start: Integers
    neighbour: Integers
    weights: Array

    @classmethod
    def of(cls, mesh: TriangleMesh) -> SurfaceFit:
        """Fits over two rings of neighbours, or more if these do not determine a quadratic."""
        count = len(mesh.material)
        tails, heads = mesh.corners.ravel(), np.roll(mesh.corners, -1, axis=1).ravel()
        both = np.concatenate([tails, heads]), np.concatenate([heads, tails])
        ring = sparse.csr_matrix((np.ones(len(both[0])), both), shape=(count, count))
        ring.data[:] = 1.0
        spans = mesh.material[both[1]] - mesh.material[both[0]]
        lengths = np.linalg.norm(spans, axis=1)
        edge = np.bincount(both[0], lengths, count) / np.bincount(both[0], minlength=count)
        reach, parts = ring, []
        waiting = np.arange(count)
        for rings in range(2, _MOST_RINGS + 1):
            reach = (reach @ ring + reach).tocsr()
            fit = _fits(mesh.material, reach, edge, waiting, last=rings == _MOST_RINGS)
            parts.append(fit[:3])
            waiting = waiting[~fit[3]]
            if len(waiting) == 0:
                break
        node, neighbour, weights = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        order = np.argsort(node, kind="stable")
        start = np.concatenate([[0], np.cumsum(np.bincount(node, minlength=count))]).astype(np.int64)
        vertex = mesh.point_vertices
        return cls(mesh, start, vertex[neighbour[order]], np.ascontiguousarray(weights[order]))

    def forms(self, positions: Array) -> tuple[Array, Array, Array]:
        """∂φ/∂ξ (nm, 2, 3), I11 I12 I22 (nm, 3) [-] and II11 II12 II22 (nm, 3) [1/m] at every material point.

        positions: vertices of the deformed mesh, (nv, 3) [m].
        """
        mesh = self.mesh
        gradient, second = _forms(positions, mesh.point_vertices, self.start, self.neighbour, self.weights)
        count = len(mesh.material)
        first = _metric(positions, mesh.triangles, mesh.corners, mesh.inverse_rest, mesh.areas, count)
        return gradient, first, second


def _fits(
    material: Array, reach: sparse.csr_matrix, edge: Array, nodes: Integers, *, last: bool
) -> tuple[Integers, Integers, Array, Flags]:
    """Fits of ``nodes`` over the neighbours in ``reach``: node, neighbour, weights; which were determined."""
    table = reach[nodes].tocoo()
    row, other = table.row.astype(np.int64), table.col.astype(np.int64)
    keep = nodes[row] != other
    row, other = row[keep], other[keep]
    scale = edge[nodes][row]
    u, v = ((material[other] - material[nodes[row]]) / scale[:, None]).T
    terms = np.column_stack([u, v, 0.5 * u * u, u * v, 0.5 * v * v])
    # Near vertices count most, so that the fit follows the cloth; the second ring makes it determined and calm.
    nearness = np.exp(-0.5 * (u * u + v * v))
    normal = np.zeros((len(nodes), 25))
    products = (nearness[:, None, None] * terms[:, :, None] * terms[:, None, :]).reshape(-1, 25)
    for k in range(25):
        normal[:, k] = np.bincount(row, products[:, k], len(nodes))
    normal = normal.reshape(-1, 5, 5)
    spectrum = np.linalg.eigvalsh(normal)
    good = spectrum[:, 0] > _REGULAR * spectrum[:, -1]
    if last:
        # A sliver: hold back the second derivatives that it does not determine.
        normal[~good] += np.diag([0.0, 0.0, 1.0, 1.0, 1.0]) * (_REGULAR * spectrum[~good, -1])[:, None, None]
        good[:] = True
    kept = good[row]
    row, other, scale, terms, nearness = row[kept], other[kept], scale[kept], terms[kept], nearness[kept]
    inverse = np.zeros_like(normal)
    inverse[good] = np.linalg.inv(normal[good])
    weights = np.einsum("kij,kj->ki", inverse[row], nearness[:, None] * terms)
    weights /= scale[:, None] ** np.array([1.0, 1.0, 2.0, 2.0, 2.0])
    return nodes[row], other, weights, good


@numba.njit(cache=True, error_model="numpy")
def _forms(positions, vertex, start, neighbour, weights):
    count = len(vertex)
    gradient, second = np.zeros((count, 2, 3)), np.zeros((count, 3))
    slopes, bends = np.zeros((2, 3)), np.zeros((3, 3))
    for node in range(count):
        slopes[:] = 0.0
        bends[:] = 0.0
        here = vertex[node]
        for k in range(start[node], start[node + 1]):
            other = neighbour[k]
            for c in range(3):
                apart = positions[other, c] - positions[here, c]
                slopes[0, c] += weights[k, 0] * apart
                slopes[1, c] += weights[k, 1] * apart
                for d in range(3):
                    bends[d, c] += weights[k, 2 + d] * apart
        gradient[node] = slopes
        n0 = slopes[0, 1] * slopes[1, 2] - slopes[0, 2] * slopes[1, 1]
        n1 = slopes[0, 2] * slopes[1, 0] - slopes[0, 0] * slopes[1, 2]
        n2 = slopes[0, 0] * slopes[1, 1] - slopes[0, 1] * slopes[1, 0]
        size = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
        if size > 0.0:
            for d in range(3):
                second[node, d] = (n0 * bends[d, 0] + n1 * bends[d, 1] + n2 * bends[d, 2]) / size
    return gradient, second


@numba.njit(cache=True, error_model="numpy")
def _metric(positions, triangles, corners, inverse_rest, areas, count):
    """Mean first fundamental form of the triangles around every material point, weighted by area."""
    metric, total = np.zeros((count, 3)), np.zeros(count)
    edge = np.empty((2, 3))
    for t in range(len(triangles)):
        inverse = inverse_rest[t]
        for d in range(3):
            u = positions[triangles[t, 1], d] - positions[triangles[t, 0], d]
            v = positions[triangles[t, 2], d] - positions[triangles[t, 0], d]
            edge[0, d] = u * inverse[0, 0] + v * inverse[1, 0]
            edge[1, d] = u * inverse[0, 1] + v * inverse[1, 1]
        xx = edge[0, 0] ** 2 + edge[0, 1] ** 2 + edge[0, 2] ** 2
        xy = edge[0, 0] * edge[1, 0] + edge[0, 1] * edge[1, 1] + edge[0, 2] * edge[1, 2]
        yy = edge[1, 0] ** 2 + edge[1, 1] ** 2 + edge[1, 2] ** 2
        for c in range(3):
            point = corners[t, c]
            metric[point, 0] += areas[t] * xx
            metric[point, 1] += areas[t] * xy
            metric[point, 2] += areas[t] * yy
            total[point] += areas[t]
    for point in range(count):
        for d in range(3):
            metric[point, d] /= total[point]
    return metric
