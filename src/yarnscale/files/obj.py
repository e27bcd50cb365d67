"""Wavefront OBJ: triangle meshes with material coordinates as texture coordinates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def obj_text(
    positions: NDArray[np.float64],
    triangles: NDArray[np.int64],
    material: NDArray[np.float64] | None = None,
    corners: NDArray[np.int64] | None = None,
) -> str:
    """An OBJ file of vertices (n, 3) [m] and triangles (m, 3); material points (k, 2) [m] become ``vt``.

    corners: material points of the triangles' corners (m, 3); None where they are numbered as the vertices.
    """
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in positions]
    if material is not None:
        points = triangles if corners is None else corners
        lines += [f"vt {u:.9g} {v:.9g}" for u, v in material]
        lines += [
            "f " + " ".join(f"{v}/{p}" for v, p in zip(*rows, strict=True))
            for rows in zip(triangles + 1, points + 1, strict=True)
        ]
    else:
        lines += ["f " + " ".join(map(str, triangle)) for triangle in triangles + 1]
    return "\n".join(lines) + "\n"
