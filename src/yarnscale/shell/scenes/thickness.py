"""Thickness of a cloth, from the provenance of its material."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from yarnscale.shell.contact.cloth_contact import ClothContact, ContactSettings
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.mesh import TriangleMesh
from yarnscale.shell.state import ClothState

UNKNOWN_THICKNESS = 1e-3
"""Of cloth whose material has none [m]."""
_LARGEST_SHARE = 0.4
"""Of the edges of a mesh: thicker flat cloth would repel its own next-nearest triangles."""

_LEAST_PART = 0.1
"""Of the thickness of cloth whose layers start closer to each other than that."""


def garment_thickness(material: ShellMaterial, mesh: TriangleMesh, start: ClothState) -> float:
    """``cloth_thickness`` [m] of a mesh with close layers at the start: at most their distance.

    Otherwise the layers would be pushed apart at the start. At least a tenth of the thickness of the cloth.
    """
    thickness = cloth_thickness(material, mesh)
    closest = ClothContact(mesh, ContactSettings(thickness)).closest(start.positions)
    return min(thickness, max(closest, _LEAST_PART * thickness))


def cloth_thickness(material: ShellMaterial, mesh: TriangleMesh) -> float:
    """Distance [m] at which layers of a cloth begin to repel each other.

    The thickness of the fabric from the provenance of a homogenized material (field ``thickness``), or 1 mm; at most
    0.4 of the median edge of the mesh.
    """
    provenance = getattr(material, "provenance", {})
    given = provenance.get("thickness") if isinstance(provenance, Mapping) else None
    thickness = float(given) if isinstance(given, int | float) and 0 < given < np.inf else UNKNOWN_THICKNESS
    return min(thickness, _LARGEST_SHARE * mesh.median_edge)
