"""Elements of the elastic energy of a mesh: which triangle determines I and which II, also at free edges.

A triangle at a free edge has only two of its three fold angles. HYLC20 counts the third as zero, so that the last row
does not curl about the free edge. ``extrapolate`` takes II of such a triangle from its complete neighbours (half of
the area each), whose stencils contain all its vertices. Neighbours across a seam are not used, since their II refers
to another material frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from yarnscale.arrays import Array, Flags, Integers
from yarnscale.errors import InputError
from yarnscale.numerics.kernel import BLOCK
from yarnscale.shell.elastic.element_loops import forms_of_blocks
from yarnscale.shell.elastic.strain import FLAGS, GEOMETRY, REFERENCE, REST, follow_angles, form_kernels
from yarnscale.shell.mesh import TriangleMesh

FreeEdges = Literal["extrapolate", "zero"]


@dataclass(frozen=True, eq=False)
class ShellElements:
    """Elements in the order of the mesh, in blocks, padded with elements of no area.

    stencils: (blocks, BLOCK, 6); present: whether a stencil vertex is used, same shape; geometry: (blocks, 18,
    BLOCK), see ``strain.GEOMETRY`` (its reference angles change as the cloth moves); areas: (blocks, BLOCK)
    [m²]; triangles: the triangle of I, (blocks, BLOCK).
    """

    stencils: Integers
    present: Flags
    geometry: Array
    areas: Array
    triangles: Integers

    @property
    def blocks(self) -> int:
        return len(self.areas)

    def follow(self, positions: Array) -> float:
        """Set the reference angles to the fold angles at positions (nv, 3); the largest |angle| [rad]."""
        return float(follow_angles(positions, self.stencils, self.geometry))

    @property
    def reference_angles(self) -> Array:
        """Reference fold angles [rad], a copy, (blocks, 3, BLOCK)."""
        return self.geometry[:, REFERENCE].copy()

    def set_reference_angles(self, angles: Array) -> None:
        """Restore earlier reference angles."""
        self.geometry[:, REFERENCE] = angles

    def forms(self, positions: Array) -> Array:
        """(I11, I12, I22, II11, II12, II22) of every element at positions (nv, 3), (blocks, 6, BLOCK)."""
        forms = np.empty((self.blocks, 6, BLOCK))
        nothing = np.empty((0, 0, 0))
        address = form_kernels().value.address
        forms_of_blocks(positions, self.stencils, self.geometry, address, nothing, forms)
        return forms


def shell_elements(mesh: TriangleMesh, *, free_edges: FreeEdges = "extrapolate") -> ShellElements:
    """Elements of a mesh; see the module for the two treatments of free edges. Raises InputError."""
    if free_edges not in get_args(FreeEdges):
        raise InputError("free_edges", expected=" or ".join(get_args(FreeEdges)), found=free_edges)
    rows = _own(mesh, np.arange(len(mesh.triangles)), 1.0)
    if free_edges == "extrapolate":
        rows = _extrapolated(mesh, rows)
    stencils, geometry, areas, triangles = rows
    padding = -len(areas) % BLOCK
    repeat = np.concatenate([np.arange(len(areas)), np.full(padding, len(areas) - 1)]).astype(np.int64)
    present = np.ones((len(areas), 6), bool)
    present[:, 3:] = geometry[:, FLAGS] != 0
    # The apex of the triangle of I is needed whatever the flag says; extrapolation only uses complete stencils.
    return ShellElements(
        np.ascontiguousarray(stencils[repeat].reshape(-1, BLOCK, 6)),
        present[repeat].reshape(-1, BLOCK, 6),
        np.ascontiguousarray(geometry[repeat].reshape(-1, BLOCK, GEOMETRY).transpose(0, 2, 1)),
        np.concatenate([areas, np.zeros(padding)]).reshape(-1, BLOCK),
        triangles[repeat].reshape(-1, BLOCK),
    )


_Rows = tuple[Integers, Array, Array, Integers]
"""Stencils (n, 6), geometry (n, 18), areas (n,), triangles (n,)."""


def _own(mesh: TriangleMesh, which: Integers, share: float) -> _Rows:
    """Elements whose I and II come from the same triangle."""
    geometry = np.zeros((len(which), GEOMETRY))
    columns = mesh.inverse_rest[which].transpose(0, 2, 1).reshape(-1, 4)
    geometry[:, 0:4] = geometry[:, 4:8] = columns
    geometry[:, FLAGS] = mesh.has_neighbour[which]
    geometry[:, REST] = mesh.rest_angles[which]
    return mesh.stencils[which], geometry, share * mesh.areas[which], which


def _extrapolated(mesh: TriangleMesh, rows: _Rows) -> _Rows:
    """Replace triangles at free edges by elements on the stencils of their complete neighbours."""
    complete = mesh.has_neighbour.sum(axis=1) == 3
    owner = {(int(t[k]), int(t[(k + 1) % 3])): (row, k) for row, t in enumerate(mesh.corners) for k in range(3)}
    kept, borrowed = np.ones(len(mesh.triangles), bool), []
    for row in np.flatnonzero(~complete):
        corners = mesh.corners[row]
        sides = [owner.get((int(corners[(k + 1) % 3]), int(corners[k]))) for k in range(3)]
        lenders = [side for side in sides if side is not None and complete[side[0]]]
        kept[row] = not lenders
        borrowed += [(row, *side, 1.0 / len(lenders)) for side in lenders]
    if not borrowed:
        return rows
    new = zip(*(_borrowing(mesh, *entry) for entry in borrowed), strict=True)
    both = [np.concatenate([a[kept], np.array(b)]) for a, b in zip(rows, new, strict=True)]
    # Keep the order of the mesh, so that blocks of elements touch nearby memory.
    order = np.argsort(both[3], kind="stable")
    return tuple(array[order] for array in both)  # type: ignore[return-value]


def _borrowing(
    mesh: TriangleMesh, row: int, lender: int, edge: int, share: float
) -> tuple[Integers, Array, float, int]:
    """One element with II of ``lender`` and I of ``row``, which lies across the lender's edge."""
    turn = [(edge + k) % 3 for k in range(3)]
    stencil = np.concatenate([mesh.stencils[lender, turn], mesh.stencils[lender, [3 + k for k in turn]]])
    geometry = np.zeros(GEOMETRY)
    own = mesh.material[mesh.corners[lender, turn]]
    # The borrower's corner that is not on the shared edge.
    apex = mesh.material[mesh.corners[row][~np.isin(mesh.corners[row], mesh.corners[lender])][0]]
    geometry[0:4] = np.linalg.inv(np.column_stack([own[1] - own[0], own[2] - own[0]])).T.ravel()
    geometry[4:8] = np.linalg.inv(np.column_stack([own[1] - own[0], apex - own[0]])).T.ravel()
    geometry[8] = 1.0
    geometry[FLAGS] = 1.0
    geometry[REST] = mesh.rest_angles[lender, turn]
    return stencil, geometry, share * float(mesh.areas[row]), row
