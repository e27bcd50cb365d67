"""Drag of the air on cloth that moves across its surface: force per area = drag · |v_n| v_n against the motion.

Of the two speeds |v_n| is taken from the start of the step, v_n from its end: linear in the unknowns and stable for
any step.
"""

from __future__ import annotations

import numpy as np

from yarnscale.arrays import Array
from yarnscale.numerics.factor import SymmetricPattern
from yarnscale.numerics.sums import add_diagonal_blocks
from yarnscale.shell.mesh import TriangleMesh


def drag_entries(
    mesh: TriangleMesh, pattern: SymmetricPattern, positions: Array, velocities: Array, drag: float
) -> Array:
    """Entries in the elastic ``pattern`` of the matrix D with force −D v [kg/s].

    positions [m], velocities [m/s]: of the start of the step, (nv, 3); drag: [kg/m³]. Every vertex has a third of its
    triangles' area and their mean normal: D has a block drag · A |v·n| n nᵀ for each.
    """
    x = positions[mesh.triangles]
    sixth = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]) / 6.0
    corners = mesh.triangles.ravel()
    areas = np.column_stack([np.bincount(corners, np.repeat(sixth[:, k], 3), mesh.vertex_count) for k in range(3)])
    size = np.maximum(np.linalg.norm(areas, axis=1), 1e-300)
    normals = areas / size[:, None]
    blocks = normals[:, :, None] * normals[:, None, :]
    blocks *= (drag * size * np.abs(np.einsum("ni,ni->n", velocities, normals)))[:, None, None]
    entries = np.zeros(pattern.entries)
    add_diagonal_blocks(pattern, entries, blocks)
    return entries
