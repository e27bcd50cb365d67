"""The thickness of cloth comes from its material, as far as the mesh allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from yarnscale.shell.materials.orthotropic import OrthotropicMaterial
from yarnscale.shell.mesh import TriangleMesh, rectangle
from yarnscale.shell.scenes.scene import drape
from yarnscale.shell.scenes.thickness import UNKNOWN_THICKNESS, cloth_thickness, garment_thickness
from yarnscale.shell.state import ClothState

SHEET = OrthotropicMaterial(40.0, 5.0, 40.0, 15.0, 1.0, 1.0, bend_weft=1e-6, bend_bias=1e-6, bend_warp=1e-6)


@pytest.mark.parametrize(
    ("told", "spacing", "expected"),
    [
        (None, 0.01, UNKNOWN_THICKNESS),
        (2.5e-3, 0.01, 2.5e-3),
        (2.5e-3, 0.002, 0.4 * 0.002),
        ("thin", 0.01, UNKNOWN_THICKNESS),
        (-1.0, 0.01, UNKNOWN_THICKNESS),
    ],
)
def test_thickness_is_that_of_the_fabric_or_what_the_mesh_allows(told: object, spacing: float, expected: float) -> None:
    material = replace(SHEET, provenance={} if told is None else {"thickness": told})
    thickness = cloth_thickness(material, rectangle(0.06, 0.06, spacing))
    # Lattices fit the sheet with edges near the spacing.
    assert thickness == pytest.approx(expected, rel=0.1 if spacing < 0.005 else 1e-12)


@pytest.mark.parametrize(("gap", "expected"), [(5e-3, 1e-3), (4e-4, 4e-4), (1e-6, 1e-4)])
def test_layers_of_a_garment_do_not_start_within_each_others_thickness(gap: float, expected: float) -> None:
    one = rectangle(0.06, 0.06, 0.01)
    panel = np.concatenate([one.panel, one.panel + np.array([0.1, 0.0])])
    space = np.concatenate([one.assembled, one.assembled + np.array([0.0, 0.0, gap])])
    mesh = TriangleMesh(panel, np.concatenate([one.triangles, one.triangles + one.vertex_count]), assembled=space)
    assert garment_thickness(SHEET, mesh, ClothState.flat(mesh)) == pytest.approx(expected)


def test_scenes_take_it() -> None:
    contact = drape(replace(SHEET, provenance={"thickness": 1.7e-3})).cloth.contact
    assert contact is not None and contact.thickness == 1.7e-3
