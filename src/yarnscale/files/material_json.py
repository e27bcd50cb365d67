"""Material files: our own versioned JSON, and a reader that also takes published HYLC files.

docs/reference/shell_material_format.md describes the format. Numbers are written so that reading gives the same floats.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from yarnscale.arrays import Array
from yarnscale.checked import checked
from yarnscale.errors import InputError, located, misspelt
from yarnscale.files.atomic import write_json, write_text
from yarnscale.files.fields import Fields, read_json
from yarnscale.files.hylc_json import hylc_material, hylc_text, is_hylc
from yarnscale.files.material_library import MATERIAL, file_of, names
from yarnscale.shell.materials.compact import CompactMaterial, SpringNetwork, shapes_of
from yarnscale.shell.materials.friction import Sliders
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.materials.orthotropic import DirectionalMaterial, OrthotropicMaterial
from yarnscale.shell.materials.spline_material import SplineMaterial
from yarnscale.shell.materials.stiffening import StiffeningMaterial

FORMAT = "yarnscale-material"
VERSION = 3
"""Orthotropic materials of older versions are the same and are read."""

COMPACT_UNITS = {"terms": "J/m^2", "scale, samples": "1, 1, 1, 1/m, 1/m, 1/m", "density": "kg/m^2"}
"""Another set of units in a file is refused, not converted."""
FRICTION_UNITS = {"stiffnesses": "J/m^2", "same_sign, other_sign": "m^2/J"}
DIRECTIONAL: dict[str, tuple[type[DirectionalMaterial], dict[str, str]]] = {
    "orthotropic": (OrthotropicMaterial, {"stretch, shear, area": "N/m", "bend": "J", "density": "kg/m^2"}),
    "stiffening": (
        StiffeningMaterial,
        {"stretch, stiffening, compression, coupling, shear, log_area": "N/m", "rate, saturation": "1", "bend": "J",
         "density": "kg/m^2"},
    ),
}  # fmt: skip
"""Kind of a file → class and units."""


@checked
def read_material(source: str | os.PathLike[str]) -> CompactMaterial | DirectionalMaterial | SplineMaterial:
    """Material of the library by its name (``material_library``), or of a yarnscale material file or a published HYLC
    JSON file, told apart by content.

    Raises InputError (file and field) where the source is none of them, or broken.
    """
    path = Path(file_of(source, MATERIAL))
    if path.suffix == "" and os.fspath(source) == path.name and not path.exists():
        expected = f"a material file or one of {', '.join(names())}"
        raise InputError("unknown shell material", expected=expected, found=misspelt(path.name, names()))
    content = read_json(path)
    if "format" not in content and is_hylc(content):
        return hylc_material(content, path)
    fields = Fields(content, path)
    if "format" not in content or content["format"] != FORMAT:
        found = repr(content.get("format", "no format field"))[:60]
        raise fields.fault("format", expected=f"'{FORMAT}', or a HYLC JSON file", found=found)
    version = fields.integer("version")
    kind = fields.text("kind")
    if version < VERSION and kind in ("spline", "compact"):
        expected = f"{VERSION}, which this release reads: run yarnscale homogenize again"
        raise fields.fault("version", expected=expected, found=version)
    if not 1 <= version <= VERSION:
        raise fields.fault("version", expected=f"{VERSION}, the one this release reads", found=version)
    if kind not in ("compact", *DIRECTIONAL):
        expected = ", ".join(repr(known) for known in ("compact", *DIRECTIONAL))
        raise fields.fault("kind", expected=expected, found=repr(kind)[:60])
    _check_units(fields, COMPACT_UNITS if kind == "compact" else DIRECTIONAL[kind][1])
    density, provenance = fields.number("density", positive=True), fields.fields("provenance").content
    if kind == "compact":
        return _read_compact(fields, density, provenance)
    terms, make = fields.fields("terms"), DIRECTIONAL[kind][0]
    constants = {name: terms.number(name) for name in make.constants()}
    with located(fields.path):
        return make(**constants, density=density, provenance=provenance)


def is_material(path: str | Path) -> bool:
    """Whether a name is in the library, or a file says that it is a shell material, ours or HYLC's; False where there
    is no such JSON file."""
    if os.fspath(path) in names():
        return True
    if Path(path).suffix.lower() != ".json" or not Path(path).is_file():
        return False
    content = read_json(path)
    return content.get("format") == FORMAT or ("format" not in content and is_hylc(content))


@checked
def write_material(path: str | Path, material: ShellMaterial) -> None:
    """Write a material file whole or not at all; InputError where the target cannot be written.

    Also raises InputError where the provenance does not consist of JSON values.
    """
    if isinstance(material, SplineMaterial):
        return write_text(path, hylc_text(material))
    if isinstance(material, CompactMaterial):
        kind, units, body = "compact", COMPACT_UNITS, _compact_content(material)
    elif isinstance(material, DirectionalMaterial):
        kind, units = next((name, units) for name, (of, units) in DIRECTIONAL.items() if of is type(material))
        body = {"terms": {name: getattr(material, name) for name in material.constants()}}
    else:
        raise InputError("material", expected="a compact, orthotropic or stiffening one", found=type(material).__name__)
    head = {"format": FORMAT, "version": VERSION, "kind": kind, "units": units, "density": float(material.density)}
    write_json(path, {**head, "provenance": dict(material.provenance), **body})


def _compact_content(material: CompactMaterial) -> dict[str, object]:
    content: dict[str, object] = {
        "mirrored": bool(material.mirrored),
        "scale": material.scale.tolist(),
        "terms": {"constant": float(material.constant), **_short(material.springs)},
        "trusted": {"spacing": float(material.spacing), **_short({"samples": material.samples}, digits=5)},
    }
    if material.sliders is not None:
        content["friction"] = {"units": FRICTION_UNITS, **_short(material.sliders, digits=9)}
    return content


def _short(arrays: Any, *, digits: int = 17) -> dict[str, object]:
    """Nested lists of the numbers of arrays by name, rounded to some significant digits."""
    named = arrays if isinstance(arrays, dict) else arrays._asdict()
    rounded = {name: [float(f"{x:.{digits}g}") for x in array.ravel()] for name, array in named.items()}
    return {name: np.array(rounded[name]).reshape(array.shape).tolist() for name, array in named.items()}


def _read_compact(fields: Fields, density: float, provenance: Mapping[str, object]) -> CompactMaterial:
    terms, trusted, sliders = fields.fields("terms"), fields.fields("trusted"), None
    counts = [len(terms.numbers(f"{name}_offsets")) for name in ("step", "spring", "wall")]
    shapes = shapes_of(*counts)._asdict()
    springs = SpringNetwork(**{name: _matrix(terms, name, shape) for name, shape in shapes.items()})
    found = trusted.get("samples")
    rows = len(found) if isinstance(found, list) else 0
    with located(fields.path):
        if "friction" in fields.content:
            friction = fields.fields("friction")
            _check_units(friction, FRICTION_UNITS)
            count = len(friction.numbers("stiffnesses"))
            shapes = {
                "directions": (count, 6), "bends": (count, counts[0]), "stiffnesses": (count,), "rest": (count,),
                "same_sign": (count, 6), "other_sign": (count, 6),
            }  # fmt: skip
            sliders = Sliders.checked(*(_matrix(friction, name, shape) for name, shape in shapes.items()))
        return CompactMaterial(
            terms.number("constant"), fields.numbers("scale", shape=(6,)), springs, density=density,
            mirrored=fields.flag("mirrored"), samples=trusted.numbers("samples", shape=(rows, 6)),
            spacing=trusted.number("spacing", positive=True), provenance=provenance, sliders=sliders,
        )  # fmt: skip


def _matrix(terms: Fields, name: str, shape: tuple[int, ...]) -> Array:
    """Numbers of a shape of which some sides may be zero (JSON has no empty rows)."""
    if 0 in shape and terms.get(name) in ([], [[]] * shape[0]):
        return np.zeros(shape)
    return terms.numbers(name, shape=shape)


def _check_units(fields: Fields, units: Mapping[str, str]) -> None:
    found = fields.fields("units")
    for name, unit in units.items():
        if found.text(name) != unit:
            raise found.fault(name, expected=f"'{unit}'", found=repr(found.get(name))[:60])
