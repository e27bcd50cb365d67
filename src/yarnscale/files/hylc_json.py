"""The material files published with HYLC20 ("HYLC JSON").

Strains in the file are normalised, x = strain / scale; terms are cubic (bicubic) Hermite splines of them,
continued linearly outside. Terms are kept as they are: published one-dimensional splines are not zero at zero
strain. The sampled range and the provenance have no place in the layout.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from yarnscale.arrays import Array
from yarnscale.errors import InputError
from yarnscale.files.fields import Fields
from yarnscale.shell.materials.spline_material import SplineMaterial
from yarnscale.shell.materials.spline_patches import AXES, PLANES
from yarnscale.shell.materials.tables import BicubicSpline, CubicSpline

STRAIN_SHIFT = (1, 0, 1, 0, 0)
"""The published programs subtract these from (√I11, I12/√(I11 I22), √I22, λ_x, λ_y) to get strains."""


def is_hylc(content: Mapping[str, object]) -> bool:
    """Whether a parsed file looks like a HYLC material."""
    return "coeffs" in content or "strain scale" in content


def hylc_material(content: Mapping[str, object], path: str | Path) -> SplineMaterial:
    """Material of the parsed content of a HYLC JSON file; ``path`` is named in errors and provenance."""
    fields = Fields(content, path)
    scale = fields.numbers("strain scale", shape=(5,))
    if not np.all(scale > 0):
        raise fields.fault("strain scale", expected="positive numbers", found=scale.tolist())
    density = fields.number("density", positive=True)
    terms = fields.fields("coeffs")
    axes = _axes(terms, scale)
    provenance = {"source": "HYLC JSON", "file": Path(path).name, "strain_scale": scale.tolist()}
    return SplineMaterial(terms.number("const"), axes, _planes(terms, scale), density, provenance=provenance)


def _axes(terms: Fields, scale: Array) -> tuple[CubicSpline, ...]:
    found: dict[int, CubicSpline] = {}
    for item in terms.items("1D"):
        axis = item.integer("k")
        if axis not in range(len(AXES)) or axis in found:
            raise item.fault("k", expected="each of 0 to 4 once", found=axis)
        knots = item.knots("t")
        values, slopes = item.numbers("p", shape=knots.shape), item.numbers("m", shape=knots.shape)
        found[axis] = CubicSpline(knots * scale[axis], values, slopes / scale[axis])
    for axis, name in enumerate(AXES):
        if axis not in found:
            raise InputError(f"missing one-dimensional term k = {axis} ({name})", where=terms.path)
    return tuple(found[axis] for axis in range(len(AXES)))


def _planes(terms: Fields, scale: Array) -> dict[tuple[int, int], BicubicSpline]:
    found: dict[tuple[int, int], BicubicSpline] = {}
    for item in terms.items("2D"):
        pair = (item.integer("k0"), item.integer("k1"))
        if pair not in PLANES or pair in found:
            expected = f"each of {PLANES} at most once"
            raise item.fault("k0, k1", expected=expected, found=pair)
        u, v = item.knots("tu"), item.knots("tv")

        def nodal(key: str, *, item: Fields = item, shape: tuple[int, int] = (len(v), len(u))) -> Array:
            return item.numbers(key, shape=(shape[0] * shape[1],)).reshape(shape).T

        twists = nodal("muv") if "muv" in item.content else np.zeros((len(u), len(v)))
        a, b = scale[pair[0]], scale[pair[1]]
        found[pair] = BicubicSpline(u * a, v * b, nodal("p"), nodal("mu") / a, nodal("mv") / b, twists / (a * b))
    return found


def hylc_text(material: SplineMaterial) -> str:
    """The HYLC JSON of a material."""
    return json.dumps(hylc_content(material), allow_nan=False) + "\n"


def hylc_content(material: SplineMaterial) -> dict[str, object]:
    """The JSON object of a material; strains are normalised by the scale it was read with, or by its range."""
    scale = _scale(material)
    terms: dict[str, object] = {
        "const": material.constant,
        "1D": [
            {"k": k, "t": (f.knots / scale[k]).tolist(), "p": f.values.tolist(), "m": (f.slopes * scale[k]).tolist()}
            for k, f in enumerate(material.axes)
        ],
        "2D": [
            {
                "k0": i,
                "k1": j,
                "tu": (f.knots_u / scale[i]).tolist(),
                "tv": (f.knots_v / scale[j]).tolist(),
                # Rows of the file go along the second strain.
                "p": f.values.T.ravel().tolist(),
                "mu": (f.slopes_u * scale[i]).T.ravel().tolist(),
                "mv": (f.slopes_v * scale[j]).T.ravel().tolist(),
                "muv": (f.twists * scale[i] * scale[j]).T.ravel().tolist(),
            }
            for (i, j), f in material.planes.items()
        ],
    }
    return {
        "density": material.density,
        "strain scale": scale.tolist(),
        "strain shift": list(STRAIN_SHIFT),
        "coeffs": terms,
    }


def _scale(material: SplineMaterial) -> Array:
    stored = material.provenance.get("strain_scale")
    if isinstance(stored, list) and len(stored) == len(AXES) and all(isinstance(x, float) and x > 0 for x in stored):
        return np.array(stored)
    return np.max(np.abs(material.range), axis=1)
