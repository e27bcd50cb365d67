"""Material files: our own versioned JSON, and a reader that also takes published HYLC files.

The format is described in docs/material_file.md. Numbers are written so that reading gives the same floats.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from yarnscale.checked import checked
from yarnscale.errors import InputError
from yarnscale.files.atomic import write_text
from yarnscale.files.hylc_json import hylc_material, is_hylc
from yarnscale.files.inside_json import inside_content, read_inside
from yarnscale.files.json_fields import Fields, read_json
from yarnscale.shell.materials.material import ShellMaterial
from yarnscale.shell.materials.orthotropic import CONSTANTS, OrthotropicMaterial
from yarnscale.shell.materials.spline_material import SplineMaterial
from yarnscale.shell.materials.spline_patches import AXES, PLANES
from yarnscale.shell.materials.tables import BicubicSpline, CubicSpline, Tail

Array = NDArray[np.float64]

Built = TypeVar("Built")

FORMAT = "yarnscale-material"
VERSION = 1

UNITS = {
    "energy_density": "J/m^2",
    "density": "kg/m^2",
    "s_x": "1",
    "s_a": "1",
    "s_y": "1",
    "lambda_x": "1/m",
    "lambda_y": "1/m",
}
"""Units of version 1; another set in a file is refused, not converted."""

ORTHOTROPIC_UNITS = {"stretch, shear, area": "N/m", "bend": "J", "density": "kg/m^2"}


@checked
def read_material(path: str | Path) -> SplineMaterial | OrthotropicMaterial:
    """Material of a yarnscale material file or a published HYLC JSON file, told apart by content.

    Raises InputError (file and field) where the file is neither, or broken.
    """
    content = read_json(path)
    if "format" not in content and is_hylc(content):
        return hylc_material(content, path)
    fields = Fields(content, path)
    if "format" not in content or content["format"] != FORMAT:
        found = repr(content.get("format", "no format field"))[:60]
        raise fields.fault("format", expected=f"'{FORMAT}', or a HYLC JSON file", found=found)
    version = fields.integer("version")
    if version != VERSION:
        raise fields.fault("version", expected=f"{VERSION}, the one this release reads", found=version)
    kind = fields.text("kind")
    if kind == "spline":
        return _read_spline(fields)
    if kind == "orthotropic":
        return _read_orthotropic(fields)
    raise fields.fault("kind", expected="'spline' or 'orthotropic'", found=repr(kind)[:60])


def is_material(path: str | Path) -> bool:
    """Whether a file says that it is a shell material, ours or HYLC's; False where there is no such JSON file."""
    if Path(path).suffix.lower() != ".json" or not Path(path).is_file():
        return False
    content = read_json(path)
    return content.get("format") == FORMAT or ("format" not in content and is_hylc(content))


@checked
def write_material(path: str | Path, material: ShellMaterial) -> None:
    """Write a material file whole or not at all; InputError where the target cannot be written.

    Also raises InputError where the provenance does not consist of JSON values.
    """
    write_text(path, material_text(material))


def material_text(material: ShellMaterial) -> str:
    """The content of the material file of a material, ending in a newline."""
    if isinstance(material, SplineMaterial):
        body = _spline_content(material)
    elif isinstance(material, OrthotropicMaterial):
        body = _orthotropic_content(material)
    else:
        raise InputError(
            "material", expected="a spline or orthotropic material", found=type(material).__name__
        )
    content = {"format": FORMAT, "version": VERSION, **body}
    try:
        return _layout(content) + "\n"
    except (TypeError, ValueError) as error:
        raise InputError(
            "material cannot be written", expected="provenance of plain JSON values", found=error
        ) from None


def _layout(value: object, indent: str = "") -> str:
    """JSON with one row of numbers a line, so that a file can be read and compared by eye."""
    inner = indent + "  "
    if isinstance(value, Mapping) and value:
        rows = [f"{inner}{json.dumps(str(key))}: {_layout(item, inner)}" for key, item in value.items()]
        return "{\n" + ",\n".join(rows) + f"\n{indent}}}"
    if isinstance(value, (list, tuple)) and any(isinstance(item, (list, tuple, Mapping)) for item in value):
        return "[\n" + ",\n".join(inner + _layout(item, inner) for item in value) + f"\n{indent}]"
    return json.dumps(value, allow_nan=False, ensure_ascii=False)


def _spline_content(material: SplineMaterial) -> dict[str, object]:
    axes = [
        {
            "strain": AXES[axis],
            "tail": f.tail.value,
            "knots": f.knots.tolist(),
            "values": f.values.tolist(),
            "slopes": f.slopes.tolist(),
        }
        for axis, f in enumerate(material.axes)
    ]
    inside = {} if material.inside is None else {"inside": inside_content(material.inside)}
    planes = [
        {
            "strains": [AXES[i], AXES[j]],
            "knots": [f.knots_u.tolist(), f.knots_v.tolist()],
            "values": f.values.tolist(),
            "slopes_first": f.slopes_u.tolist(),
            "slopes_second": f.slopes_v.tolist(),
            "twists": f.twists.tolist(),
        }
        for (i, j), f in material.planes.items()
    ]
    return {
        "kind": "spline",
        "units": UNITS,
        "density": material.density,
        "range": {name: box.tolist() for name, box in zip(AXES, material.range, strict=True)},
        "provenance": dict(material.provenance),
        "terms": {"constant": material.constant, "axes": axes, "planes": planes, **inside},
    }


def _read_spline(fields: Fields) -> SplineMaterial:
    _check_units(fields, UNITS)
    box = fields.fields("range")
    limits = np.array([box.numbers(name, shape=(2,)) for name in AXES])
    terms = fields.fields("terms")
    return _built(
        fields,
        lambda: SplineMaterial(
            terms.number("constant"),
            _read_axes(terms),
            dict(_read_plane(item) for item in _distinct(terms.items("planes"), "strains")),
            density=fields.number("density", positive=True),
            range=limits,
            provenance=fields.fields("provenance").content,
            inside=read_inside(terms.fields("inside")) if "inside" in terms.content else None,
        ),
    )


def _read_axes(terms: Fields) -> tuple[CubicSpline, ...]:
    found: dict[str, CubicSpline] = {}
    for item in _distinct(terms.items("axes"), "strain"):
        name, tail = item.text("strain"), item.text("tail")
        if name not in AXES:
            raise item.fault("strain", expected=f"one of {', '.join(AXES)}", found=name[:60])
        if tail not in list(Tail):
            raise item.fault("tail", expected=f"one of {', '.join(Tail)}", found=tail[:60])
        knots = item.knots("knots")
        values, slopes = (item.numbers(key, shape=knots.shape) for key in ("values", "slopes"))
        found[name] = CubicSpline(knots, values, slopes, Tail(tail))
    missing = [name for name in AXES if name not in found]
    if missing:
        raise terms.fault(
            "axes", expected=f"a term of each of {', '.join(AXES)}", found=f"no {', '.join(missing)}"
        )
    return tuple(found[name] for name in AXES)


def _read_plane(item: Fields) -> tuple[tuple[int, int], BicubicSpline]:
    names = item.get("strains")
    pairs = {(AXES[i], AXES[j]): (i, j) for i, j in PLANES}
    pair = (
        pairs.get(tuple(names))
        if isinstance(names, list) and all(isinstance(n, str) for n in names)
        else None
    )
    if pair is None:
        raise item.fault("strains", expected="two different strains, in-plane first", found=repr(names)[:60])
    both = item.get("knots")
    if not isinstance(both, list) or len(both) != 2:
        raise item.fault("knots", expected="two lists of knots", found=repr(both)[:60])
    sides = Fields({"first": both[0], "second": both[1]}, item.path, item.label("knots"))
    u, v = sides.knots("first"), sides.knots("second")
    shape = (len(u), len(v))
    data = [item.numbers(key, shape=shape) for key in ("values", "slopes_first", "slopes_second", "twists")]
    return pair, BicubicSpline(u, v, *data)


def _orthotropic_content(material: OrthotropicMaterial) -> dict[str, object]:
    return {
        "kind": "orthotropic",
        "units": ORTHOTROPIC_UNITS,
        "density": float(material.density),
        "provenance": dict(material.provenance),
        "terms": {name: getattr(material, name) for name in CONSTANTS},
    }


def _read_orthotropic(fields: Fields) -> OrthotropicMaterial:
    _check_units(fields, ORTHOTROPIC_UNITS)
    terms = fields.fields("terms")
    constants = {name: terms.number(name) for name in CONSTANTS}
    density, provenance = fields.number("density", positive=True), fields.fields("provenance").content
    return _built(fields, lambda: OrthotropicMaterial(**constants, density=density, provenance=provenance))


def _check_units(fields: Fields, units: Mapping[str, str]) -> None:
    found = fields.fields("units")
    for name, unit in units.items():
        if found.text(name) != unit:
            raise found.fault(name, expected=f"'{unit}'", found=repr(found.get(name))[:60])


def _distinct(items: list[Fields], key: str) -> list[Fields]:
    """The items, refused if two have the same ``key``."""
    seen: list[object] = []
    for item in items:
        value = item.get(key)
        if value in seen:
            raise item.fault(key, expected="each at most once", found=repr(value)[:60])
        seen.append(value)
    return items


def _built(fields: Fields, build: Callable[[], Built]) -> Built:
    """What ``build`` returns, with the file named in its errors."""
    try:
        return build()
    except InputError as error:
        if error.where is not None:
            raise
        raise InputError(error.what, where=fields.path, expected=error.expected, found=error.found) from None
