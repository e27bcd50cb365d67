"""The cloth of a scene file: sheets, garments that the project makes, and meshes from OBJ files."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np

from yarnscale.files.garment_units import LENGTHS, Notice
from yarnscale.files.obj_garment import read_garment
from yarnscale.files.scene_section import SceneTable
from yarnscale.shell.garments.wardrobe import SEAMS, SWEATER, T_SHIRT, ShirtCut, shirt
from yarnscale.shell.mesh import TriangleMesh, disk, rectangle
from yarnscale.shell.state import ClothState

CUTS = {"sweater": SWEATER, "tshirt": T_SHIRT}
"""Garments by name."""
_PLACE = ("position", "tilt")
_SIZES = tuple(field.name for field in fields(ShirtCut))


def read_mesh(section: SceneTable, on_notice: Notice) -> TriangleMesh:
    """The mesh that the table [mesh] describes; sentences about it go to ``on_notice``. Raises InputError."""
    if "file" in section.content:
        return _from_file(section, on_notice)
    shape = section.choice_or("shape", "rectangle", ("rectangle", "disk", *CUTS))
    if shape in CUTS:
        section.known("shape", "spacing", "rest_angle", *_SIZES, *_PLACE)
        sizes = {name: section.number(name) for name in _SIZES if name in section.content}
        cut = section.build(lambda: replace(CUTS[shape], **sizes))
        angles = _seam_angles(section)
        return section.build(lambda: shirt(shape, cut, section.number_or("spacing", 0.02), rest_angles=angles).mesh)
    grain = math.radians(section.number_or("grain", 0.0))
    metres = LENGTHS[section.choice_or("unit", "m", tuple(LENGTHS))]
    if shape == "disk":
        section.known("shape", "unit", "radius", "spacing", "grain", *_PLACE)
        radius, spacing = (metres * section.number(key) for key in ("radius", "spacing"))
        return section.build(lambda: disk(radius, spacing, grain=grain))
    section.known(
        "shape", "unit", "width", "height", "spacing", "grain", "finer_edges", "irregularity", "seed", *_PLACE
    )
    width, height, spacing = (metres * section.number(key) for key in ("width", "height", "spacing"))
    return section.build(
        lambda: rectangle(
            width,
            height,
            spacing,
            grain=grain,
            finer_edges=section.number_or("finer_edges", 0.0),
            irregularity=section.number_or("irregularity", 0.0),
            seed=section.integer_or("seed", 0),
        )
    )


def is_garment(section: SceneTable) -> bool:
    """Whether the table [mesh] describes a garment or a mesh of a file, with self-contact, and not a sheet."""
    return "file" in section.content or section.text_or("shape", "") in CUTS


def read_start(section: SceneTable, mesh: TriangleMesh) -> ClothState:
    """The mesh as cut or assembled, turned about the x-axis by ``tilt`` degrees, then shifted by ``position``."""
    tilt = math.radians(section.number_or("tilt", 0.0))
    x, y, z = mesh.assembled.T
    c, s = math.cos(tilt), math.sin(tilt)
    turned = np.column_stack([x, c * y - s * z, s * y + c * z])
    positions = turned + section.vector_or("position", (0.0, 0.0, 0.0))
    return ClothState(positions, np.zeros_like(positions))


def _seam_angles(section: SceneTable) -> dict[str, float]:
    """Folds of the seams of a shirt at rest [rad], by kind: one number of degrees for all, or a table."""
    if not isinstance(section.content.get("rest_angle"), dict):
        return dict.fromkeys(SEAMS, math.radians(section.number_or("rest_angle", 0.0)))
    table = section.fields("rest_angle", optional=True).known(*SEAMS)
    return {kind: math.radians(table.number(kind)) for kind in table.content}


def _from_file(section: SceneTable, on_notice: Notice) -> TriangleMesh:
    section.known("file", "material_file", "unit", "scale", "material_scale", "grain", "weld", "rest_angle", *_PLACE)
    flat = section.beside(section.text("material_file")) if "material_file" in section.content else None
    scales = {key: section.number(key, positive=True) for key in ("scale", "material_scale") if key in section.content}
    weld = section.content.get("weld")
    if isinstance(weld, str):
        raise section.fault("weld", expected="true, false or a distance [m]", found=repr(weld)[:60])
    if not (weld is None or isinstance(weld, bool)):
        weld = section.number("weld", positive=True)
    return section.build(
        lambda: read_garment(
            section.beside(section.text("file")),
            material=flat,
            unit=section.choice_or("unit", "m", tuple(LENGTHS)) if "unit" in section.content else None,
            grain=math.radians(section.number_or("grain", 0.0)),
            weld=weld,
            on_notice=on_notice,
            **scales,
        ).with_seam_angle(math.radians(section.number_or("rest_angle", 0.0)))
    )
