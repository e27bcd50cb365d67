"""How thick a cloth is, where its material knows the fabric it was made from."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from yarnscale.shell.contact.cloth_contact import ClothContact, ContactSettings
from yarnscale.shell.elastic.energy import ElementMaterial
from yarnscale.shell.mesh import TriangleMesh
from yarnscale.shell.state import ClothState

UNKNOWN_THICKNESS = 1e-3
"""Of cloth whose material does not say [m]."""
_LARGEST_SHARE = 0.4
"""Of the edges of a mesh: thicker cloth would repel its own next-nearest triangles while it lies flat."""

_LEAST_PART = 0.1
"""Of the thickness of cloth whose layers start closer to each other than that."""


def garment_thickness(material: ElementMaterial, mesh: TriangleMesh, start: ClothState) -> float:
    """``cloth_thickness`` [m] of a mesh whose layers may lie close to each other at the start: no more than they do.

    Thicker layers would be driven apart when the run begins. At least a tenth of the thickness of the cloth.
    """
    thickness = cloth_thickness(material, mesh)
    closest = ClothContact(mesh, ContactSettings(thickness)).closest(start.positions)
    return min(thickness, max(closest, _LEAST_PART * thickness))


def cloth_thickness(material: ElementMaterial, mesh: TriangleMesh) -> float:
    """Distance [m] at which layers of a cloth begin to repel each other.

    The thickness of the fabric from the provenance of a homogenized material (field ``thickness``), or 1 mm; at most
    0.4 of the median edge of the mesh.
    """
    provenance = getattr(material, "provenance", {})
    told = provenance.get("thickness") if isinstance(provenance, Mapping) else None
    thickness = float(told) if isinstance(told, int | float) and 0 < told < np.inf else UNKNOWN_THICKNESS
    return min(thickness, _LARGEST_SHARE * mesh.median_edge)
