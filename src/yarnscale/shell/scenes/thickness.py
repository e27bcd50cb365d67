"""How thick a cloth is, where its material knows the fabric it was made from."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from yarnscale.shell.elastic.energy import ElementMaterial
from yarnscale.shell.mesh import TriangleMesh

UNKNOWN_THICKNESS = 1e-3
"""Of cloth whose material does not say [m]."""
_LARGEST_SHARE = 0.4
"""Of the edges of a mesh: thicker cloth would repel its own next-nearest triangles while it lies flat."""


def cloth_thickness(material: ElementMaterial, mesh: TriangleMesh) -> float:
    """Distance [m] at which layers of a cloth begin to repel each other.

    The thickness of the fabric from the provenance of a homogenized material (field ``thickness``), or 1 mm; at most
    0.4 of the median edge of the mesh.
    """
    provenance = getattr(material, "provenance", {})
    told = provenance.get("thickness") if isinstance(provenance, Mapping) else None
    thickness = float(told) if isinstance(told, int | float) and 0 < told < np.inf else UNKNOWN_THICKNESS
    return min(thickness, _LARGEST_SHARE * mesh.median_edge)
